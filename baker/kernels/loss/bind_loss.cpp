// Python bindings of the loss.
#include "arrays.h"
#include "loss/loss.h"

using namespace nb::literals;

template <class Real>
static nb::tuple loss(Input<Real, -1, -1, 3> image, Input<uint16_t, -1, -1, 3> tone, double tone_scale)
{
    const size_t height = image.shape(0), width = image.shape(1);
    if (tone.shape(0) != height || tone.shape(1) != width)
        throw nb::type_error("image and target must have the same size");
    require(tone_scale > 0, "tone_scale must be positive");
    auto by_image = allocate<Real>({height, width, 3}), error = allocate<Real>({height, width});
    double value;
    {
        nb::gil_scoped_release unlocked;
        value =
            image_loss({height, width, image.data(), tone.data(), tone_scale, by_image.data(), error.data()});
    }
    return nb::make_tuple(value, by_image, error);
}

void bind_loss(nb::module_& m)
{
    const char* doc =
        "Return the loss, its gradient with respect to image (H, W, 3) and its share per pixel (H, W).";
    m.def("image_loss", &loss<float>, "image"_a.noconvert(), "tone"_a.noconvert(), "tone_scale"_a, doc);
    m.def("image_loss", &loss<double>, "image"_a.noconvert(), "tone"_a.noconvert(), "tone_scale"_a, doc);
}
