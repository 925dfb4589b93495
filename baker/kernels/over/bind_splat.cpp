// Python bindings of splatting activated Gaussians, and of its gradient.
#include <algorithm>

#include "dispatch.h"
#include "over/pinhole.h"
#include "over/splat.h"

using namespace nb::literals;

template <class Real> struct GaussianInput {
    Input<Real, -1, 3> position;
    Input<Real, -1, 4> rotation;
    Input<Real, -1, 3> scale;
    Input<Real, -1> opacity;
    Input<Real, -1, -1, 3> sh;
};

template <class Real> static GaussianArrays<const Real> view(const GaussianInput<Real>& in)
{
    const size_t count = in.position.shape(0);
    if (in.rotation.shape(0) != count || in.scale.shape(0) != count || in.opacity.shape(0) != count ||
        in.sh.shape(0) != count)
        throw nb::type_error("position, rotation, scale, opacity and sh must have the same first dimension");
    return {count, degree_of(in.sh.shape(1)), in.position.data(), in.rotation.data(), in.scale.data(),
        in.opacity.data(), in.sh.data()};
}

template <class Real>
static nb::tuple forward(Input<Real, -1, 3> position, Input<Real, -1, 4> rotation, Input<Real, -1, 3> scale,
    Input<Real, -1> opacity, Input<Real, -1, -1, 3> sh, nb::handle pinhole, nb::handle blend)
{
    const auto gaussians = view<Real>({position, rotation, scale, opacity, sh});
    const Camera camera = camera_from(pinhole);
    const Blend operation = blend_from(blend);
    const size_t width = camera.width, height = camera.height;
    auto image = allocate<Real>({height, width, 3}), transmittance = allocate<Real>({height, width});
    auto frame = new Frame<Real>;
    nb::object owner = nb::cast(frame, nb::rv_policy::take_ownership);
    {
        nb::gil_scoped_release unlocked;
        frame->splat(gaussians, camera, operation, splat_kernels<Real>().project);
        std::copy_n(frame->pixels().radiance, 3 * width * height, image.data());
        std::copy_n(frame->pixels().transmittance, width * height, transmittance.data());
    }
    return nb::make_tuple(image, transmittance, owner);
}

template <class Real>
static nb::tuple backward(Frame<Real>& frame, Input<Real, -1, 3> position, Input<Real, -1, 4> rotation,
    Input<Real, -1, 3> scale, Input<Real, -1> opacity, Input<Real, -1, -1, 3> sh,
    Input<Real, -1, -1, 3> by_image, Input<Real, -1, -1> by_transmittance)
{
    const auto gaussians = view<Real>({position, rotation, scale, opacity, sh});
    const size_t n = gaussians.count, k = sh.shape(1);
    const size_t height = frame.camera().height, width = frame.camera().width;
    if (!frame.is_of(gaussians))
        throw nb::type_error("the Gaussians are not those of the frame");
    if (by_image.shape(0) != height || by_image.shape(1) != width || by_transmittance.shape(0) != height ||
        by_transmittance.shape(1) != width)
        throw nb::type_error("by_image and by_transmittance must have the size of the frame");
    auto by_position = allocate<Real>({n, 3}), by_rotation = allocate<Real>({n, 4}),
         by_scale = allocate<Real>({n, 3}), by_opacity = allocate<Real>({n}),
         by_sh = allocate<Real>({n, k, 3});
    int64_t not_finite;
    {
        nb::gil_scoped_release unlocked;
        frame.sum_moments({by_image.data(), by_transmittance.data(), nullptr});
        not_finite = frame.first_not_finite();
        frame.gradients(gaussians,
            {n, gaussians.degree, by_position.data(), by_rotation.data(), by_scale.data(), by_opacity.data(),
                by_sh.data()});
    }
    if (not_finite >= 0) {
        PyErr_Format(PyExc_FloatingPointError, "the gradient of Gaussian %lld is not finite",
            static_cast<long long>(not_finite));
        throw nb::python_error();
    }
    return nb::make_tuple(by_position, by_rotation, by_scale, by_opacity, by_sh);
}

template <class Real> static void bind_precision(nb::module_& m, const char* frame_name)
{
    nb::class_<Frame<Real>>(m, frame_name, "State that splat_backward needs from splat.")
        .def_prop_ro("entry_count", &Frame<Real>::entry_count,
            "Number of pairs of a Gaussian and a tile that it touches.");
    m.def("splat", &forward<Real>, "position"_a.noconvert(), "rotation"_a.noconvert(), "scale"_a.noconvert(),
        "opacity"_a.noconvert(), "sh"_a.noconvert(), "pinhole"_a, "blend"_a,
        "Draw activated Gaussians. Return the image (H, W, 3), the transmittance (H, W) and a Frame.");
    m.def("splat_backward", &backward<Real>, "frame"_a, "position"_a.noconvert(), "rotation"_a.noconvert(),
        "scale"_a.noconvert(), "opacity"_a.noconvert(), "sh"_a.noconvert(), "by_image"_a.noconvert(),
        "by_transmittance"_a.noconvert(),
        "Return the gradients with respect to position, rotation, scale, opacity and sh. Raise "
        "FloatingPointError if a sum over pixels is not finite.");
}

void bind_splat(nb::module_& m)
{
    bind_precision<float>(m, "FrameFloat");
    bind_precision<double>(m, "FrameDouble");
}
