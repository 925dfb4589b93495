// Python bindings of training on raw parameters: the forward pass, and the backward pass fused with the
// optimiser's step.
#include <algorithm>
#include <array>
#include <atomic>
#include <optional>

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>

#include "dispatch.h"
#include "over/pinhole.h"
#include "over/splat.h"
#include "parallel.h"

using namespace nb::literals;

namespace {

struct Workspace {
    Frame<float> frame;
    bool stepped = true; // the frame has had its step, or there is no frame
};

template <class Value, nb::ssize_t... Shape>
using Writable = nb::ndarray<Value, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;

template <class Value, nb::ssize_t... Shape>
Writable<Value, Shape...> writable(
    nb::handle object, const char* name, std::array<int64_t, sizeof...(Shape)> shape)
{
    Writable<Value, Shape...> array;
    if (!nb::try_cast(object.attr(name), array, false))
        throw nb::type_error((std::string(name) + ": wrong dtype, shape or layout").c_str());
    for (size_t i = 0; i < shape.size(); ++i)
        if (int64_t(array.shape(i)) != shape[i])
            throw nb::type_error((std::string(name) + ": wrong shape").c_str());
    return array;
}

// The arrays of a gsgi.baker.over.raw_gaussians.RawGaussians, N Gaussians with K coefficients each. They live
// as long as this: their attributes can be temporary.
struct RawInput {
    int64_t n, k;
    Writable<float, -1, 3> position;
    Writable<float, -1, 4> rotation;
    Writable<float, -1, 3> log_scale;
    Writable<float, -1> logit_opacity;
    Writable<float, -1, -1, 3> sh;

    explicit RawInput(nb::handle raw)
        : n(nb::cast<int64_t>(raw.attr("position").attr("shape")[0]))
        , k(nb::cast<int64_t>(raw.attr("sh").attr("shape")[1]))
        , position(writable<float, -1, 3>(raw, "position", {n, 3}))
        , rotation(writable<float, -1, 4>(raw, "rotation", {n, 4}))
        , log_scale(writable<float, -1, 3>(raw, "log_scale", {n, 3}))
        , logit_opacity(writable<float, -1>(raw, "logit_opacity", {n}))
        , sh(writable<float, -1, -1, 3>(raw, "sh", {n, k, 3}))
    {
    }

    GaussianArrays<float> arrays() const
    {
        return {size_t(n), degree_of(size_t(k)), position.data(), rotation.data(), log_scale.data(),
            logit_opacity.data(), sh.data()};
    }
};

} // namespace

static GaussianArrays<const float> constant(const GaussianArrays<float>& a)
{
    return {a.count, a.degree, a.position, a.rotation, a.scale, a.opacity, a.sh};
}

static nb::tuple forward(Workspace& workspace, nb::handle raw, nb::handle pinhole, nb::handle blend)
{
    const RawInput input(raw);
    const auto gaussians = constant(input.arrays());
    const Camera camera = camera_from(pinhole);
    const Blend operation = blend_from(blend);
    const size_t width = camera.width, height = camera.height;
    auto image = allocate<float>({height, width, 3}), transmittance = allocate<float>({height, width});
    {
        nb::gil_scoped_release unlocked;
        workspace.stepped = true; // in case splat throws
        workspace.frame.splat(gaussians, camera, operation, instruction_set().project_raw);
        workspace.stepped = false;
        std::copy_n(workspace.frame.pixels().radiance, 3 * width * height, image.data());
        std::copy_n(workspace.frame.pixels().transmittance, width * height, transmittance.data());
    }
    return nb::make_tuple(image, transmittance);
}

static nb::tuple step(Workspace& workspace, nb::handle raw, nb::handle adam, Input<float, -1, -1, 3> by_image,
    std::array<double, 5> rates, std::optional<Input<float, -1, -1>> error)
{
    Frame<float>& frame = workspace.frame;
    const RawInput raw_input(raw), mean_input(adam.attr("mean")), square_input(adam.attr("square"));
    const auto parameters = raw_input.arrays(), mean = mean_input.arrays(), square = square_input.arrays();
    const size_t n = parameters.count, height = frame.camera().height, width = frame.camera().width;
    require(!workspace.stepped, "each forward allows one step");
    for (const auto& arrays : {parameters, mean, square})
        if (!frame.is_of(constant(arrays)))
            throw nb::type_error("raw and adam must have the size of the Gaussians that were drawn");
    if (by_image.shape(0) != height || by_image.shape(1) != width ||
        (error && (error->shape(0) != height || error->shape(1) != width)))
        throw nb::type_error("by_image and error must have the size of the image");
    auto contribution = allocate<float>({n}), errors = allocate<float>({n}), radius = allocate<float>({n}),
         mean2d_gradient = allocate<float>({n});
    const auto steps = writable<int32_t, -1>(adam, "steps", {int64_t(n)});
    Step step = {parameters, mean, square, steps.data(), {}, contribution.data(), errors.data(),
        radius.data(), mean2d_gradient.data()};
    std::copy(rates.begin(), rates.end(), step.rates);
    int64_t not_finite;
    {
        nb::gil_scoped_release unlocked;
        frame.sum_moments({by_image.data(), nullptr, error ? error->data() : nullptr});
        not_finite = frame.first_not_finite();
        step.update = not_finite < 0;
        std::atomic<size_t> first{n};
        parallel_for(n, GRAIN, [&](size_t begin, size_t end) {
            const size_t found = instruction_set().step(
                step, frame.camera(), frame.footprints(), frame.keys(), frame.sums(), begin, end);
            if (found < end)
                lower(first, found);
        });
        if (step.update && first < n)
            not_finite = int64_t(first);
        workspace.stepped = true;
    }
    return nb::make_tuple(contribution, errors, radius, mean2d_gradient, not_finite);
}

void bind_train(nb::module_& m)
{
    nb::class_<Workspace>(m, "Workspace", "Memory for an image and its gradient.")
        .def(nb::init<>())
        .def("forward", &forward, "raw"_a, "pinhole"_a, "blend"_a,
            "Draw raw Gaussians. Return the image (H, W, 3) and the transmittance (H, W).")
        .def("step", &step, "raw"_a, "adam"_a, "by_image"_a.noconvert(), "rates"_a,
            "error"_a.noconvert().none(),
            "Step raw and adam in place. "
            "Return contribution, error, radius, mean2d_gradient (N,) and not_finite.")
        .def_prop_ro("byte_count", [](const Workspace& w) { return w.frame.byte_count(); })
        .def_prop_ro(
            "pair_count", [](const Workspace& w) { return w.frame.pair_count(); },
            "Number of pairs of a Gaussian and a pixel that the last forward call blended.");
}
