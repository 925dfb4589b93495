// The kernels for one instruction set. Compiled once for each, with INSTRUCTION_SET defined as its name.
//
// Nothing here may share its name with other objects: the linker would keep only one copy of an inline
// function, and that copy might use instructions that the processor does not support.
#include "instruction_set.h"

#include "loss/loss_band.h"
#include "over/adam.h"
#include "over/rasterise_backward.h"
#include "over/touch.h"
#include "surface/field_read.h"

namespace INSTRUCTION_SET {

template <class Real>
static void store_footprints(const Group& group, const Projection& p, const Vec3& colour,
    const Camera& camera, Footprint<Real>* footprints, uint32_t* keys)
{
    double depth[8], mean_x[8], mean_y[8], whiten_x[8], whiten_y[8], shear[8], log2_opacity[8], half_width[8],
        half_height[8], red[8], green[8], blue[8];
    p.depth.store(depth), p.mean_x.store(mean_x), p.mean_y.store(mean_y), p.whiten_x.store(whiten_x);
    p.whiten_y.store(whiten_y), p.shear.store(shear), p.log2_opacity.store(log2_opacity);
    p.half_width.store(half_width), p.half_height.store(half_height);
    colour.x.store(red), colour.y.store(green), colour.z.store(blue);
    for (int i = 0; i < group.count; ++i) {
        // Range of pixel rows and columns whose centres lie within half_height and half_width of the mean.
        const double low = mean_y[i] - half_height[i] - 0.5, high = mean_y[i] + half_height[i] - 0.5;
        const double left = mean_x[i] - half_width[i] - 0.5, right = mean_x[i] + half_width[i] - 0.5;
        const bool seen = (p.drawn >> i & 1) && high >= 0 && low <= camera.height - 1 && right >= 0 &&
            left <= camera.width - 1;
        keys[group.index[i]] = NOT_DRAWN;
        if (!seen)
            continue;
        const float key = float(depth[i]);
        std::memcpy(&keys[group.index[i]], &key, sizeof(key));
        const int first = low > 0 ? int(low) : 0,
                  last = high < camera.height - 1 ? int(high) : camera.height - 1;
        footprints[group.index[i]] = {mean_x[i], mean_y[i], Real(whiten_x[i]), Real(whiten_y[i]),
            Real(shear[i]), Real(log2_opacity[i]), {Real(red[i]), Real(green[i]), Real(blue[i])},
            uint16_t(first / TILE_SIZE), uint16_t(last / TILE_SIZE)};
    }
}

template <class Real, bool Raw>
static void project_range(const GaussianArrays<const Real>& arrays, const Camera& camera, const Blend& blend,
    size_t begin, size_t end, Footprint<Real>* footprints, uint32_t* keys)
{
    for (size_t i = begin; i < end; i += 8) {
        const Group group = consecutive(i, end);
        const Gaussian stored = load_activated(arrays, group);
        const Projection projection = project(Raw ? activate(stored) : stored, camera, blend);
        Vec3 colour = {0.0, 0.0, 0.0};
        if (projection.drawn)
            colour = visible_colour(arrays, group, stored.position - broadcast(camera.position));
        store_footprints(group, projection, colour, camera, footprints, keys);
    }
}

template <class Real>
constexpr SplatKernels<Real> SPLAT = {project_range<Real, false>, count_tiles<Real>, list_tiles<Real>,
    blend_tile<Real>, blend_tile_backward<Real>, gradients<Real>};

#define NAME_OF(name) #name
#define NAME(name) NAME_OF(name)

extern const InstructionSet KERNELS;
const InstructionSet KERNELS = {NAME(INSTRUCTION_SET), SPLAT<float>, SPLAT<double>,
    project_range<float, true>, step, visit_band<float>, visit_band<double>, FIELD<float>, FIELD<double>};

} // namespace INSTRUCTION_SET
