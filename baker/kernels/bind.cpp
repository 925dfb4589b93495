// Python's view of the kernels: shapes and dtypes are checked here, memory is allocated here.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <stdexcept>

#include "parallel.h"
#include "sh.h"
#include "splat.h"

namespace nb = nanobind;
using namespace nb::literals;

template <class Real, nb::ssize_t... Shape>
using Input = nb::ndarray<const Real, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
template <class Real> using Output = nb::ndarray<nb::numpy, Real, nb::c_contig>;

static void require(bool condition, const char* message)
{
    if (!condition)
        throw std::invalid_argument(message); // ValueError
}

// A gsgi.runtime.camera.Pinhole.
static Camera camera_from(nb::handle pinhole)
{
    const auto pose = nb::cast<nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>>(
        pinhole.attr("view_from_world"));
    Camera camera;
    for (size_t i = 0; i < 3; ++i) {
        camera.rotation[i] = {pose(i, 0), pose(i, 1), pose(i, 2)};
        camera.translation[i] = pose(i, 3);
    }
    camera.position =
        -1.0 * (camera.translation * camera.rotation); // the pose is rigid: transpose is inverse
    const auto number = [&](const char* name) { return nb::cast<double>(pinhole.attr(name)); };
    camera.fx = number("fx"), camera.fy = number("fy"), camera.cx = number("cx"), camera.cy = number("cy");
    camera.width = nb::cast<int>(pinhole.attr("width")),
    camera.height = nb::cast<int>(pinhole.attr("height"));
    require(camera.width > 0 && camera.height > 0, "pinhole: width and height must be positive");
    require(camera.fx > 0 && camera.fy > 0, "pinhole: fx and fy must be positive");
    return camera;
}

// A gsgi.runtime.gaussians.Blend.
static Blend blend_from(nb::handle blend)
{
    const auto number = [&](const char* name) { return nb::cast<double>(blend.attr(name)); };
    const Blend result{number("near"), number("dilation"), number("alpha_min"), number("alpha_max")};
    require(result.dilation >= 0, "blend: dilation must not be negative");
    require(0 < result.alpha_min && result.alpha_min <= result.alpha_max && result.alpha_max < 1,
        "blend: 0 < alpha_min <= alpha_max < 1 is required");
    return result;
}

template <class Real> struct GaussianInput {
    Input<Real, -1, 3> position;
    Input<Real, -1, 4> rotation;
    Input<Real, -1, 3> scale;
    Input<Real, -1> opacity;
    Input<Real, -1, -1, 3> sh;
};

template <class Real> static GaussianArrays<const Real> view(const GaussianInput<Real>& in)
{
    const size_t count = in.position.shape(0), coefficients = in.sh.shape(1);
    int degree = 0;
    while (degree < 3 && size_t((degree + 1) * (degree + 1)) < coefficients)
        ++degree;
    if (size_t((degree + 1) * (degree + 1)) != coefficients)
        throw nb::type_error("sh: shape must be (N, K, 3) with K one of 1, 4, 9, 16");
    if (in.rotation.shape(0) != count || in.scale.shape(0) != count || in.opacity.shape(0) != count ||
        in.sh.shape(0) != count)
        throw nb::type_error("position, rotation, scale, opacity and sh must have the same first dimension");
    return {count, degree, in.position.data(), in.rotation.data(), in.scale.data(), in.opacity.data(),
        in.sh.data()};
}

template <class Real> static Output<Real> allocate(std::initializer_list<size_t> shape)
{
    size_t size = 1;
    for (size_t extent : shape)
        size *= extent;
    Real* data = new Real[size];
    return Output<Real>(
        data, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<Real*>(p); }));
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
        *frame = splat(gaussians, camera, operation, image.data());
        std::copy(frame->transmittance.begin(), frame->transmittance.end(), transmittance.data());
    }
    return nb::make_tuple(image, transmittance, owner);
}

template <class Real>
static nb::tuple backward(const Frame<Real>& frame, Input<Real, -1, 3> position, Input<Real, -1, 4> rotation,
    Input<Real, -1, 3> scale, Input<Real, -1> opacity, Input<Real, -1, -1, 3> sh,
    Input<Real, -1, -1, 3> by_image, Input<Real, -1, -1> by_transmittance)
{
    const auto gaussians = view<Real>({position, rotation, scale, opacity, sh});
    const size_t n = gaussians.count, k = sh.shape(1), height = frame.camera.height,
                 width = frame.camera.width;
    if (n != frame.footprints.size() || n * k != frame.coefficient_count)
        throw nb::type_error("the Gaussians are not those of the frame");
    if (by_image.shape(0) != height || by_image.shape(1) != width || by_transmittance.shape(0) != height ||
        by_transmittance.shape(1) != width)
        throw nb::type_error("by_image and by_transmittance must have the size of the frame");
    auto by_position = allocate<Real>({n, 3}), by_rotation = allocate<Real>({n, 4}),
         by_scale = allocate<Real>({n, 3}), by_opacity = allocate<Real>({n}),
         by_sh = allocate<Real>({n, k, 3});
    {
        nb::gil_scoped_release unlocked;
        splat_backward(frame, gaussians, by_image.data(), by_transmittance.data(),
            {n, gaussians.degree, by_position.data(), by_rotation.data(), by_scale.data(), by_opacity.data(),
                by_sh.data()});
    }
    return nb::make_tuple(by_position, by_rotation, by_scale, by_opacity, by_sh);
}

static Output<double> sh_basis_of(Input<double, -1, 3> direction, int degree)
{
    require(0 <= degree && degree <= 3, "degree must be 0 to 3");
    const size_t count = direction.shape(0), k = size_t(degree + 1) * (degree + 1);
    auto basis = allocate<double>({count, k});
    for (size_t i = 0; i < count; ++i)
        sh_basis({direction(i, 0), direction(i, 1), direction(i, 2)}, degree, basis.data() + i * k);
    return basis;
}

template <class Real> static void bind_splat(nb::module_& m, const char* frame_name)
{
    nb::class_<Frame<Real>>(m, frame_name, "What splat_backward needs to know of splat.")
        .def_prop_ro(
            "entry_count", [](const Frame<Real>& frame) { return frame.lists.entries.size(); },
            "Pairs of a Gaussian and a tile that it touches.");
    m.def("splat", &forward<Real>, "position"_a.noconvert(), "rotation"_a.noconvert(), "scale"_a.noconvert(),
        "opacity"_a.noconvert(), "sh"_a.noconvert(), "pinhole"_a, "blend"_a,
        "Image (H, W, 3), transmittance (H, W) and Frame of activated Gaussians.");
    m.def("splat_backward", &backward<Real>, "frame"_a, "position"_a.noconvert(), "rotation"_a.noconvert(),
        "scale"_a.noconvert(), "opacity"_a.noconvert(), "sh"_a.noconvert(), "by_image"_a.noconvert(),
        "by_transmittance"_a.noconvert(), "Gradients by position, rotation, scale, opacity and sh.");
}

void bind_loss(nb::module_& m); // bind_loss.cpp

NB_MODULE(_kernels, m)
{
    m.attr("TILE_SIZE") = TILE_SIZE;
    m.def("set_thread_count", &set_thread_count, "count"_a,
        "Threads of later calls; 0 means one per core (default).");
    m.def("thread_count", &thread_count);
    m.def("sh_basis", &sh_basis_of, "direction"_a.noconvert(), "degree"_a,
        "(M, 3) unit vectors to (M, K) float64.");
    bind_splat<float>(m, "FrameFloat");
    bind_splat<double>(m, "FrameDouble");
    bind_loss(m);
}
