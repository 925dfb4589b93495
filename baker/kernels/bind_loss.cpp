// Python's view of the loss: shapes and dtypes are checked here, memory is allocated here.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdexcept>

#include "loss.h"

namespace nb = nanobind;
using namespace nb::literals;

template <class Value>
using Image = nb::ndarray<const Value, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
template <class Real> using Output = nb::ndarray<nb::numpy, Real, nb::c_contig>;

template <class Real> static nb::object owner_of(Real* data)
{
    return nb::capsule(data, [](void* p) noexcept { delete[] static_cast<Real*>(p); });
}

template <class Real> static nb::tuple loss(Image<Real> image, Image<uint16_t> tone, double tone_scale)
{
    const size_t height = image.shape(0), width = image.shape(1);
    if (tone.shape(0) != height || tone.shape(1) != width)
        throw nb::type_error("image and target must have the same size");
    if (!(tone_scale > 0))
        throw std::invalid_argument("tone_scale must be positive"); // ValueError
    Real* const by_image = new Real[3 * height * width];
    nb::object image_owner = owner_of(by_image);
    Real* const error = new Real[height * width];
    nb::object error_owner = owner_of(error);
    double value;
    {
        nb::gil_scoped_release unlocked;
        value = image_loss({height, width, image.data(), tone.data(), tone_scale, by_image, error});
    }
    return nb::make_tuple(value, Output<Real>(by_image, {height, width, 3}, image_owner),
        Output<Real>(error, {height, width}, error_owner));
}

void bind_loss(nb::module_& m)
{
    const char* doc = "Loss, its gradient by image (H, W, 3) and its share per pixel (H, W).";
    m.def("image_loss", &loss<float>, "image"_a.noconvert(), "tone"_a.noconvert(), "tone_scale"_a, doc);
    m.def("image_loss", &loss<double>, "image"_a.noconvert(), "tone"_a.noconvert(), "tone_scale"_a, doc);
}
