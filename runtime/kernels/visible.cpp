// Which Gaussians a camera sees, and in which order: what is done on the CPU in each frame.
#include "arrays.h"
#include "sort.h"

#include <nanobind/stl/array.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <vector>

using namespace nb::literals;

using Positions = Input<float, 3, -1>; // one row for each axis: SIMD reads neighbours
using Radii = Input<float, -1>;
using Pair = std::array<float, 2>;

// Memory for `count` of a kind, the thread's own, until the next call: to ask the system for it in each frame would take
// longer than all that is done with it.
template <class T> static T* kept(size_t count)
{
    thread_local std::vector<T> memory;
    if (memory.size() < count)
        memory.resize(count);
    return memory.data();
}

// Three factors and a summand.
struct Affine {
    float x, y, z, w;

    float operator()(float a, float b, float c) const { return x * a + y * b + z * c + w; }
};

static Affine row_of(const float* row) { return {row[0], row[1], row[2], row[3]}; }

static Output<uint32_t> copy_of(const uint32_t* index, size_t count)
{
    auto list = allocate<uint32_t>({count});
    std::copy_n(index, count, list.data());
    return list;
}

static Output<uint32_t> in_view(Positions position, Radii radii, Input<float, 5, 4> planes)
{
    const size_t count = position.shape(1);
    require(radii.shape(0) == count, "one radius for each position");
    const float *const x = position.data(), *const y = x + count, *const z = y + count, *const radius = radii.data();
    uint32_t* const index = kept<uint32_t>(2 * count + 1);
    uint32_t* const outside = index + count + 1;
    std::fill_n(outside, count, 0u);
    for (int k = 0; k < 5; ++k) {
        const Affine height = row_of(planes.data() + 4 * k);
        for (size_t i = 0; i < count; ++i)
            outside[i] |= height(x[i], y[i], z[i]) >= -radius[i] ? 0u : 1u; // a NaN is outside
    }
    size_t found = 0;
    for (size_t i = 0; i < count; ++i) { // no branch: what is outside is written over
        index[found] = uint32_t(i);
        found += !outside[i];
    }
    return copy_of(index, found);
}

constexpr uint32_t UNSEEN = ~0u; // no key: depths are not 0

// Which Gaussians one lens sees.
struct Lens {
    Affine to_x, to_y, to_z; // view space
    float focal_x, focal_y, centre_x, centre_y, width, height; // px
    float limit_x, limit_y; // of x / z and y / z, beyond which a splat grows no more
    float near;             // m
    float widest;           // px, by which every splat is wider than its Gaussian

    // A conservative test of a sphere: the spectral norm of the projection's Jacobian bounds a splat's size. The depth's
    // key, which sorts the farthest first. Without branches, for SIMD; written so that a NaN fails.
    uint32_t key(float world_x, float world_y, float world_z, float radius) const
    {
        const float depth = -to_z(world_x, world_y, world_z), inverse = 1 / depth;
        const float x = to_x(world_x, world_y, world_z) * inverse, y = to_y(world_x, world_y, world_z) * inverse;
        const float x_clamped = clamped(x, limit_x), y_clamped = clamped(y, limit_y);
        const float stretch = std::sqrt(1 + x_clamped * x_clamped + y_clamped * y_clamped);
        const float reach = radius * std::max(focal_x, focal_y) * inverse * stretch + widest;
        const float column = centre_x + focal_x * x, row = centre_y - focal_y * y;
        const bool seen = (depth >= near) & (column + reach >= 0) & (column - reach <= width) & (row + reach >= 0)
            & (row - reach <= height);
        return seen ? ~std::bit_cast<uint32_t>(depth) : UNSEEN; // bits of positive floats sort as they do
    }

    static float clamped(float value, float limit)
    {
        const float below = value < limit ? value : limit;
        return below > -limit ? below : -limit;
    }
};

static Output<uint32_t> visible_order(Positions position, Radii radii, Input<float, 3, 4> view_from_world, Pair focal,
    Pair centre, Pair size, Pair limit, float near, float widest)
{
    const size_t count = position.shape(1);
    require(radii.shape(0) == count, "one radius for each position");
    const float *const x = position.data(), *const y = x + count, *const z = y + count, *const radius = radii.data();
    const float* const rows = view_from_world.data();
    const Lens lens{row_of(rows), row_of(rows + 4), row_of(rows + 8), focal[0], focal[1], centre[0], centre[1],
        size[0], size[1], limit[0], limit[1], near, widest};
    uint32_t* const keys = kept<uint32_t>(count);
    for (size_t i = 0; i < count; ++i)
        keys[i] = lens.key(x[i], y[i], z[i], radius[i]);
    Drawn* const items = kept<Drawn>(2 * count + 1);
    size_t found = 0;
    for (size_t i = count; i-- > 0;) { // the sort keeps the order of equal depths: earlier ones end in front
        items[found] = {keys[i], uint32_t(i)};
        found += keys[i] != UNSEEN;
    }
    const Drawn* const sorted = sort_by_key(items, items + count + 1, found);
    for (size_t i = 0; i < found; ++i)
        keys[i] = sorted[i].gaussian;
    return copy_of(keys, found);
}

NB_MODULE(_visible, m)
{
    m.def("in_view", &in_view, "position"_a.noconvert(), "radius"_a.noconvert(), "planes"_a.noconvert(),
        "Indices (M,) uint32, ascending, of spheres (3, N), (N,) that reach to the inner side of all planes (5, 4).");
    m.def("visible_order", &visible_order, "position"_a.noconvert(), "radius"_a.noconvert(),
        "view_from_world"_a.noconvert(), nb::kw_only(), "focal"_a, "centre"_a, "size"_a, "limit"_a, "near"_a,
        "widest"_a, "Indices (M,) uint32 of spheres (3, N), (N,) that meet an image, farthest first.");
}
