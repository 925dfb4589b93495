// Python bindings of reading Gaussians at surface points, and of its gradient.
#include <optional>

#include <nanobind/stl/optional.h>

#include "arrays.h"
#include "surface/field.h"

using namespace nb::literals;

namespace {

// The arrays of a gsgi.runtime.gaussians.Gaussians, which live as long as this: their attributes can be
// temporary.
template <class Real> struct GaussianInput {
    Input<Real, -1, 3> position, scale;
    Input<Real, -1, 4> rotation;
    Input<Real, -1> opacity;
    Input<Real, -1, -1, 3> sh;
    Input<Real, -1, -1> slope;
    bool relief;

    // With `relief`, that is read instead of the light.
    explicit GaussianInput(nb::handle gaussians, bool relief = false)
        : relief(relief)
    {
        if (!nb::try_cast(gaussians.attr("position"), position, false) ||
            !nb::try_cast(gaussians.attr("rotation"), rotation, false) ||
            !nb::try_cast(gaussians.attr("scale"), scale, false) ||
            !nb::try_cast(gaussians.attr("opacity"), opacity, false) ||
            !nb::try_cast(gaussians.attr(relief ? "relief" : "sh"), sh, false) ||
            !nb::try_cast(gaussians.attr("slope"), slope, false))
            throw nb::type_error("Gaussians: wrong dtype, shape or layout");
        const size_t n = position.shape(0), k = sh.shape(1);
        for (size_t rows : {rotation.shape(0), scale.shape(0), opacity.shape(0), sh.shape(0), slope.shape(0)})
            if (rows != n)
                throw nb::type_error(
                    "position, rotation, scale, opacity, sh and slope must have the same first dimension");
        if (relief && k != 3)
            throw nb::type_error("relief must have 3 coefficients");
        if (!relief && k != 1 && k != 4 && k != 9)
            throw nb::type_error("sh must have 1, 4 or 9 coefficients");
        if (slope.shape(1) != 0 && slope.shape(1) != 2)
            throw nb::type_error("slope must have 0 or 2 columns");
    }

    FieldArrays<Real> arrays() const
    {
        return {position.shape(0), sh.shape(1), relief ? 0 : slope.shape(1), position.data(), rotation.data(),
            scale.data(), opacity.data(), sh.data(), slope.data(), sh.data(), 3 * sh.shape(1)};
    }
};

} // namespace

template <class Real>
static FieldArrays<Real> listed(const Field<Real>& field, const GaussianInput<Real>& input)
{
    const auto arrays = input.arrays();
    require(arrays.count == field.listed(), "the Gaussians are not those that were listed");
    return arrays;
}

static FieldBlend checked(double cutoff, int sharpness, double margin)
{
    require(cutoff > 0 && cutoff < 1, "cutoff must lie between 0 and 1");
    require(sharpness >= 0, "sharpness must not be negative");
    require(margin >= 1, "margin must be at least 1");
    return {cutoff, sharpness};
}

template <class Real>
static FieldArrays<Real> tinted(FieldArrays<Real> arrays, const std::optional<Input<Real, -1, 3>>& tint)
{
    if (tint) {
        require(tint->shape(0) == arrays.count, "one tint per Gaussian is needed");
        arrays.tint = tint->data(), arrays.tint_stride = 3;
    }
    return arrays;
}

template <class Real> static void bind_precision(nb::module_& m, const char* name)
{
    using Vectors = Input<Real, -1, 3>;
    using Values = Input<Real, -1>;
    nb::class_<Field<Real>>(m, name, "Surface points at which Gaussians are read.")
        .def(
            "__init__",
            [](Field<Real>* self, Vectors position, Vectors normal, std::optional<Vectors> bend) {
                require(
                    position.shape(0) == normal.shape(0) && (!bend || bend->shape(0) == position.shape(0)),
                    "position, normal and bend must have the same length");
                new (self) Field<Real>(
                    position.shape(0), position.data(), normal.data(), bend ? bend->data() : nullptr);
            },
            "position"_a.noconvert(), "normal"_a.noconvert(), "bend"_a.noconvert() = nb::none(),
            "`bend` (S, 3) is what normal maps add to the normals, by default nothing.")
        .def(
            "list",
            [](Field<Real>& self, nb::handle gaussians, double cutoff, int sharpness, double margin) {
                const GaussianInput<Real> input(gaussians);
                const auto arrays = input.arrays();
                const FieldBlend blend = checked(cutoff, sharpness, margin);
                nb::gil_scoped_release unlocked;
                self.list(arrays, blend, margin);
            },
            "gaussians"_a, "cutoff"_a, "sharpness"_a, "margin"_a, "List the Gaussians that reach the points.")
        .def(
            "read",
            [](Field<Real>& self, nb::handle gaussians, std::optional<Vectors> tint, bool relief) {
                const GaussianInput<Real> input(gaussians, relief);
                const auto arrays = tinted(listed(self, input), tint);
                auto sums = allocate<Real>({self.count(), 4});
                nb::gil_scoped_release unlocked;
                self.read(arrays, sums.data());
                return sums;
            },
            "gaussians"_a, "tint"_a.noconvert() = nb::none(), "relief"_a = false,
            "Return sum w c and sum w at the points, (S, 4). Slopes are relative to `tint` (N, 3), by "
            "default the constant coefficients. With `relief`, c is the relief along the bend.")
        .def(
            "reached",
            [](Field<Real>& self, nb::handle gaussians, double cutoff, int sharpness, double margin,
                Vectors values, Vectors low, Vectors high) {
                const GaussianInput<Real> input(gaussians);
                const auto arrays = input.arrays();
                const FieldBlend blend = checked(cutoff, sharpness, margin);
                require(values.shape(0) == self.count(), "three values per point are needed");
                require(low.shape(0) == arrays.count && high.shape(0) == arrays.count,
                    "low and high must have three values per Gaussian");
                std::vector<ReachedPoint> found;
                {
                    nb::gil_scoped_release unlocked;
                    found = self.reached(arrays, blend, margin, values.data(), low.data(), high.data());
                }
                auto gaussian = allocate<int64_t>({found.size()}), point = allocate<int64_t>({found.size()});
                for (size_t i = 0; i < found.size(); ++i)
                    gaussian.data()[i] = found[i].gaussian, point.data()[i] = found[i].point;
                return nb::make_tuple(gaussian, point);
            },
            "gaussians"_a, "cutoff"_a, "sharpness"_a, "margin"_a, "values"_a.noconvert(), "low"_a.noconvert(),
            "high"_a.noconvert(),
            "Return the indices (P,) of Gaussians, which ascend, and of points that they would reach if "
            "they were `margin` times as large, and of whose `values` (S, 3) one lies below `low` or above "
            "`high` (N, 3). Without sharpness they face every way.")
        .def(
            "backward",
            [](Field<Real>& self, nb::handle gaussians, Vectors light, Vectors by_light,
                Values inverse_weight) {
                const GaussianInput<Real> input(gaussians);
                const auto arrays = listed(self, input);
                for (size_t n : {light.shape(0), by_light.shape(0), inverse_weight.shape(0)})
                    require(n == self.count(), "one value per point is needed");
                auto derivatives = allocate<Real>({arrays.count, FIELD_DERIVATIVES});
                nb::gil_scoped_release unlocked;
                self.backward(
                    arrays, light.data(), by_light.data(), inverse_weight.data(), derivatives.data());
                return derivatives;
            },
            "gaussians"_a, "light"_a.noconvert(), "by_light"_a.noconvert(), "inverse_weight"_a.noconvert(),
            "Return the derivatives of a loss (N, 15), see FIELD_DERIVATIVES.")
        .def(
            "transposed",
            [](Field<Real>& self, nb::handle gaussians, Vectors values, Values inverse_weight, bool relief) {
                const GaussianInput<Real> input(gaussians, relief);
                const auto arrays = listed(self, input);
                for (size_t n : {values.shape(0), inverse_weight.shape(0)})
                    require(n == self.count(), "one value per point is needed");
                auto result = allocate<Real>({arrays.count, 3 * arrays.coefficients + arrays.slopes});
                nb::gil_scoped_release unlocked;
                self.transposed(arrays, values.data(), inverse_weight.data(), result.data());
                return result;
            },
            "gaussians"_a, "values"_a.noconvert(), "inverse_weight"_a.noconvert(), "relief"_a = false,
            "Return the derivatives (N, 3 K + slopes) by sh and slope, or (N, 9) by `relief`, of the sum "
            "over the points of B . values.")
        .def(
            "normal",
            [](Field<Real>& self, nb::handle gaussians, Values weights, Values inverse_weight,
                std::optional<Vectors> tint, bool relief) {
                const GaussianInput<Real> input(gaussians, relief);
                const auto arrays = tinted(listed(self, input), tint);
                for (size_t n : {weights.shape(0), inverse_weight.shape(0)})
                    require(n == self.count(), "one value per point is needed");
                const bool free = tint.has_value();
                auto products =
                    allocate<Real>({arrays.count, 3 * arrays.coefficients + (free ? arrays.slopes : 0)});
                nb::gil_scoped_release unlocked;
                self.normal(arrays, weights.data(), inverse_weight.data(), free, products.data());
                return products;
            },
            "gaussians"_a, "weights"_a.noconvert(), "inverse_weight"_a.noconvert(),
            "tint"_a.noconvert() = nb::none(), "relief"_a = false,
            "Return `transposed` of weights (S,) times what is read. With a `tint` (N, 3), to which slopes "
            "are relative, also by slope (N, 3 K + slopes), with the other slopes 0; else by sh alone (N, "
            "3 K).")
        .def_prop_ro("entry_count", &Field<Real>::entry_count,
            "Number of pairs of a Gaussian and a block of points that it reaches.");
}

void bind_field(nb::module_& m)
{
    bind_precision<float>(m, "FieldFloat");
    bind_precision<double>(m, "FieldDouble");
}
