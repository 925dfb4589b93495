#include "splat.h"

#include <algorithm>
#include <limits>
#include <memory>

#include "parallel.h"
#include "rasterise.h"
#include "sh.h"

static constexpr size_t GRAIN = 256; // Gaussians per parallel step: some 100 us

// Finite even where a double does not fit.
template <class Real> static Real narrow(double value)
{
    constexpr double LIMIT = std::numeric_limits<Real>::max();
    return Real(std::clamp(value, -LIMIT, LIMIT));
}

template <class Real> static Vec3 load(const Real* array, size_t i)
{
    return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

template <class Real> static void store(Real* array, size_t i, const Vec3& value)
{
    for (int c = 0; c < 3; ++c)
        array[3 * i + c] = narrow<Real>(value[c]);
}

template <class Real> static Gaussian load_gaussian(const GaussianArrays<const Real>& arrays, size_t i)
{
    const Real* q = arrays.rotation + 4 * i;
    return {load(arrays.position, i), {q[0], q[1], q[2], q[3]}, load(arrays.scale, i), arrays.opacity[i]};
}

static int coefficients(int degree)
{
    return (degree + 1) * (degree + 1);
}

// Colour before negative values are cut.
template <class Real> static Vec3 raw_colour(const Real* sh, int degree, const Vec3& direction)
{
    double basis[SH_MAX];
    sh_basis(direction, degree, basis);
    Vec3 colour = {0, 0, 0};
    for (int k = 0; k < coefficients(degree); ++k)
        colour = colour + basis[k] * load(sh, k);
    return colour;
}

// `offset` is from the eye to the Gaussian.
template <class Real> static Vec3 visible_colour(const Real* sh, int degree, const Vec3& offset)
{
    Vec3 colour = raw_colour(sh, degree, (1 / std::sqrt(dot(offset, offset))) * offset);
    for (double& channel : colour)
        channel = narrow<Real>(std::max(0.0, channel));
    return colour;
}

// Writes the gradient by the coefficients, returns the one by position. `offset` is from the eye to the
// Gaussian.
template <class Real>
static Vec3 colour_backward(const Real* sh, int degree, const Vec3& offset, Vec3 by_colour, Real* by_sh)
{
    const double distance = std::sqrt(dot(offset, offset));
    const Vec3 direction = (1 / distance) * offset;
    const Vec3 colour = raw_colour(sh, degree, direction);
    for (int c = 0; c < 3; ++c)
        by_colour[c] = colour[c] >= 0 ? by_colour[c] : 0.0;

    double basis[SH_MAX];
    Vec3 basis_gradient[SH_MAX];
    sh_basis(direction, degree, basis);
    sh_basis_gradient(direction, degree, basis_gradient);
    Vec3 by_direction = {0, 0, 0};
    for (int k = 0; k < coefficients(degree); ++k) {
        store(by_sh, k, basis[k] * by_colour);
        by_direction = by_direction + dot(by_colour, load(sh, k)) * basis_gradient[k];
    }
    return (1 / distance) * (by_direction - dot(by_direction, direction) * direction);
}

template <class Real> static Tile tile_of(const Frame<Real>& frame, size_t index)
{
    const TileGrid grid{frame.camera.width, frame.camera.height};
    const size_t start = frame.lists.tile_start[index], end = frame.lists.tile_start[index + 1];
    return {frame.footprints.data(), frame.lists.entries.data() + start, int(end - start),
        int(index % grid.columns()) * TILE_SIZE, int(index / grid.columns()) * TILE_SIZE, grid, frame.blend};
}

// Fills the frame's footprints and lists.
template <class Real> static void prepare(Frame<Real>& frame, const GaussianArrays<const Real>& gaussians)
{
    const TileGrid grid{frame.camera.width, frame.camera.height};
    std::vector<uint32_t> tile_count(gaussians.count, 0);
    frame.footprints.resize(gaussians.count);
    parallel_for(gaussians.count, GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
            const Gaussian gaussian = load_gaussian(gaussians, i);
            const auto footprint = project(gaussian, frame.camera, frame.blend);
            if (!footprint)
                continue;
            for_each_tile(*footprint, grid, [&](size_t) { ++tile_count[i]; });
            if (tile_count[i] == 0)
                continue;
            const Real* sh = gaussians.sh + i * 3 * coefficients(gaussians.degree);
            frame.footprints[i] = *footprint;
            frame.footprints[i].colour =
                visible_colour(sh, gaussians.degree, gaussian.position - frame.camera.position);
        }
    });
    frame.lists = list_tiles(frame.footprints, tile_count, grid);
}

template <class Real>
Frame<Real> splat(
    const GaussianArrays<const Real>& gaussians, const Camera& camera, const Blend& blend, Real* radiance)
{
    Frame<Real> frame{camera, blend, gaussians.count * coefficients(gaussians.degree), {}, {}, {}, {}};
    prepare(frame, gaussians);
    frame.transmittance.resize(size_t(camera.width) * camera.height);
    frame.last.resize(frame.transmittance.size());
    const Coverage<Real> coverage{frame.transmittance.data(), frame.last.data()};
    parallel_for(frame.lists.tile_start.size() - 1, 1, [&](size_t begin, size_t end) {
        for (size_t tile = begin; tile < end; ++tile)
            blend_tile(tile_of(frame, tile), radiance, coverage);
    });
    return frame;
}

// From the sums over pixels to the gradient by mean and covariance. With z = conic d, the offset of a pixel
// turned by the conic, the gradient by the mean is sum(p z), that by the covariance 1/2 sum(p z z^T).
static FootprintGradient gather(const Footprint& footprint, const double* m)
{
    const double u_x = 2 * footprint.whiten_x, u_y = -footprint.shear * u_x, v_y = 2 * footprint.whiten_y;
    return {
        u_x * m[P_U],
        u_y * m[P_U] + v_y * m[P_V],
        0.5 * u_x * u_x * m[P_UU],
        0.5 * u_x * (u_y * m[P_UU] + v_y * m[P_UV]),
        0.5 * (u_y * u_y * m[P_UU] + 2 * u_y * v_y * m[P_UV] + v_y * v_y * m[P_VV]),
    };
}

template <class Real>
static void gaussian_backward(const Frame<Real>& frame, const GaussianArrays<const Real>& gaussians, size_t i,
    const Real* moments, const GaussianArrays<Real>& out)
{
    double sum[MOMENTS] = {};
    for (size_t slot = frame.lists.slot_start[i]; slot < frame.lists.slot_start[i + 1]; ++slot)
        for (int m = 0; m < MOMENTS; ++m)
            sum[m] += moments[slot * MOMENTS + m];

    const Footprint& footprint = frame.footprints[i];
    const Gaussian gaussian = load_gaussian(gaussians, i);
    const size_t sh = i * 3 * coefficients(gaussians.degree);
    const auto g = project_backward(gaussian, frame.camera, gather(footprint, sum));
    const Vec3 by_colour = colour_backward(gaussians.sh + sh, gaussians.degree,
        gaussian.position - frame.camera.position, {sum[RED], sum[GREEN], sum[BLUE]}, out.sh + sh);
    store(out.position, i, g.position + by_colour);
    store(out.scale, i, g.scale);
    for (int c = 0; c < 4; ++c)
        out.rotation[4 * i + c] = narrow<Real>(g.rotation[c]);
    out.opacity[i] = narrow<Real>(sum[P] / footprint.opacity);
}

template <class Real> static void clear(const GaussianArrays<Real>& arrays, size_t begin, size_t end)
{
    const auto zero = [&](Real* array, size_t stride) {
        std::fill(array + begin * stride, array + end * stride, Real(0));
    };
    zero(arrays.position, 3);
    zero(arrays.rotation, 4);
    zero(arrays.scale, 3);
    zero(arrays.opacity, 1);
    zero(arrays.sh, 3 * coefficients(arrays.degree));
}

template <class Real>
void splat_backward(const Frame<Real>& frame, const GaussianArrays<const Real>& gaussians,
    const Real* by_radiance, const Real* by_transmittance, const GaussianArrays<Real>& gradient)
{
    const auto moments = std::make_unique_for_overwrite<Real[]>(frame.lists.entries.size() * MOMENTS);
    const Coverage<const Real> coverage{frame.transmittance.data(), frame.last.data()};
    parallel_for(frame.lists.tile_start.size() - 1, 1, [&](size_t begin, size_t end) {
        for (size_t tile = begin; tile < end; ++tile)
            blend_tile_backward(tile_of(frame, tile), coverage, by_radiance, by_transmittance, moments.get());
    });

    parallel_for(gaussians.count, GRAIN, [&](size_t begin, size_t end) {
        clear(gradient, begin, end);
        for (size_t i = begin; i < end; ++i)
            if (frame.lists.slot_start[i] < frame.lists.slot_start[i + 1])
                gaussian_backward(frame, gaussians, i, moments.get(), gradient);
    });
}

#define INSTANTIATE(Real)                                                                              \
    template Frame<Real> splat(const GaussianArrays<const Real>&, const Camera&, const Blend&, Real*); \
    template void splat_backward(const Frame<Real>&, const GaussianArrays<const Real>&, const Real*,   \
        const Real*, const GaussianArrays<Real>&)
INSTANTIATE(float);
INSTANTIATE(double);
