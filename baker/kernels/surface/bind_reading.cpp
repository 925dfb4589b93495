// Python bindings of what sums of weights come to, and of how errors count.
#include "arrays.h"
#include "surface/reading.h"

using namespace nb::literals;

static nb::tuple filled(Input<float, -1, 4> sums, Input<float, -1, 3> coarse, float floor)
{
    const size_t count = sums.shape(0);
    require(coarse.shape(0) == count, "sums and coarse must have the same length");
    auto light = allocate<float>({count, 3}), inverse = allocate<float>({count}),
         yielding = allocate<float>({count, 3});
    {
        nb::gil_scoped_release unlocked;
        fill_gap(count, sums.data(), coarse.data(), floor, light.data(), inverse.data(), yielding.data());
    }
    return nb::make_tuple(light, inverse, yielding);
}

static auto importance(
    Input<float, -1, 3> light, Input<float, -1> level, Input<float, -1> variance, float adapts)
{
    const size_t count = light.shape(0);
    require(level.shape(0) == count && variance.shape(0) == count, "one value per point is needed");
    auto result = allocate<float>({count});
    nb::gil_scoped_release unlocked;
    importance_of(count, light.data(), level.data(), variance.data(), adapts, result.data());
    return result;
}

static nb::tuple weighed(Input<float, -1> importance, Input<float, -1, 3> residual)
{
    const size_t count = residual.shape(0);
    require(importance.shape(0) == count, "one value per point is needed");
    auto by_light = allocate<float>({count, 3});
    double loss;
    {
        nb::gil_scoped_release unlocked;
        loss = weigh(count, importance.data(), residual.data(), by_light.data());
    }
    return nb::make_tuple(by_light, loss);
}

void bind_reading(nb::module_& m)
{
    m.def("importance", importance, "light"_a.noconvert(), "level"_a.noconvert(), "variance"_a.noconvert(),
        "adapts"_a,
        "Return the importance (S,) of errors at points read as `light` (S, 3): 1 / (l^2 + variance), where "
        "l is the `level` (S,), or the mean of the light's channels divided by `adapts` where that is more.");
    m.def("weigh", weighed, "importance"_a.noconvert(), "residual"_a.noconvert(),
        "Return the derivatives (S, 3) by the light of the mean of importance |residual|^2, and that mean.");
    m.def("fill_gap", filled, "sums"_a.noconvert(), "coarse"_a.noconvert(), "floor"_a,
        "Return B at points (S, 3), 1 / (sum w + gap) (S,), and the light (S, 3) that yields to a Gaussian "
        "whose weight grows, from the `sums` (S, 4) that `read` returns and the `coarse` light (S, 3), "
        "which fills the gap below the `floor`.");
}
