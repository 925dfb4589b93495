// Turns sums over pixels into the gradient with respect to the parameters of eight Gaussians.
#pragma once

#include "over/colour.h"
#include "over/load.h"
#include "over/projection.h"

namespace INSTRUCTION_SET {

constexpr int GEOMETRY = 11; // position 3, rotation 4, scale 3, opacity 1
constexpr int PARAMETERS_MAX = GEOMETRY + 3 * SH_MAX;

// Calls visit(group) for the Gaussians in [begin, end) that were drawn, eight at a time.
template <class Visit>
ALWAYS_INLINE void for_each_drawn(const uint32_t* keys, size_t begin, size_t end, Visit&& visit)
{
    Group group = {{}, 0};
    const auto flush = [&] {
        for (int lane = group.count; lane < 8; ++lane)
            group.index[lane] = group.index[0];
        visit(group);
        group.count = 0;
    };
    for (size_t i = begin; i < end; ++i) {
        if (keys[i] == NOT_DRAWN)
            continue;
        group.index[group.count++] = i;
        if (group.count == 8)
            flush();
    }
    if (group.count > 0)
        flush();
}

// Gradient with respect to the footprints. With d the offset of a pixel from the mean and z = conic d, the
// gradient with respect to the mean is sum(p z), and with respect to the covariance 1/2 sum(p z z^T).
template <class Real>
inline FootprintGradient gather(const Footprint<Real>* footprints, const Group& group, const Real* moments)
{
    double u_x[8], v_y[8], shear[8];
    for (int lane = 0; lane < 8; ++lane) {
        const Footprint<Real>& f = footprints[group.index[lane]];
        u_x[lane] = 2 * LN_2 * f.whiten_x, v_y[lane] = 2 * LN_2 * f.whiten_y, shear[lane] = f.shear;
    }
    const auto m = [&](Moment moment) { return load(moments, group, MOMENTS, moment); };
    const Wide ux = Wide::load(u_x), vy = Wide::load(v_y), uy = 0.0 - Wide::load(shear) * ux;
    return {
        ux * m(P_U),
        uy * m(P_U) + vy * m(P_V),
        0.5 * ux * ux * m(P_UU),
        0.5 * ux * (uy * m(P_UU) + vy * m(P_UV)),
        0.5 * (uy * uy * m(P_UU) + 2.0 * uy * vy * m(P_UV) + vy * vy * m(P_VV)),
    };
}

// Writes GEOMETRY + 3 K gradients with respect to the activated parameters; that of the opacity is with
// respect to its logarithm.
template <class Real>
inline FootprintGradient gradient_of(const GaussianArrays<const Real>& arrays, const Gaussian& gaussian,
    const Group& group, const Camera& camera, const Footprint<Real>* footprints, const Real* moments,
    Wide* gradient)
{
    const FootprintGradient by_footprint = gather(footprints, group, moments);
    const auto m = [&](Moment moment) { return load(moments, group, MOMENTS, moment); };
    const GaussianGradient g = project_backward(gaussian, camera, by_footprint);
    const Vec3 offset = gaussian.position - broadcast(camera.position);
    const Vec3 position =
        g.position + colour_backward(arrays, group, offset, {m(RED), m(GREEN), m(BLUE)}, gradient + GEOMETRY);
    gradient[0] = position.x, gradient[1] = position.y, gradient[2] = position.z;
    gradient[3] = g.rotation.x, gradient[4] = g.rotation.y, gradient[5] = g.rotation.z,
    gradient[6] = g.rotation.w;
    gradient[7] = g.scale.x, gradient[8] = g.scale.y, gradient[9] = g.scale.z;
    gradient[10] = m(P);
    return by_footprint;
}

template <class Real> inline void clear(const GaussianArrays<Real>& arrays, size_t begin, size_t end)
{
    const auto zero = [&](Real* array, size_t stride) {
        std::memset(array + begin * stride, 0, (end - begin) * stride * sizeof(Real));
    };
    zero(arrays.position, 3), zero(arrays.rotation, 4), zero(arrays.scale, 3), zero(arrays.opacity, 1);
    zero(arrays.sh, 3 * arrays.coefficients());
}

template <class Real>
inline void gradients(const GaussianArrays<const Real>& arrays, const Camera& camera,
    const Footprint<Real>* footprints, const uint32_t* keys, const Real* moments, size_t begin, size_t end,
    const GaussianArrays<Real>& out)
{
    clear(out, begin, end);
    const size_t sh_size = 3 * arrays.coefficients();
    for_each_drawn(keys, begin, end, [&](const Group& group) {
        Wide g[PARAMETERS_MAX];
        const Gaussian gaussian = load_activated(arrays, group);
        gradient_of(arrays, gaussian, group, camera, footprints, moments, g);
        for (int c = 0; c < 3; ++c)
            store(out.position, group, 3, c, g[c]), store(out.scale, group, 3, c, g[7 + c]);
        for (int c = 0; c < 4; ++c)
            store(out.rotation, group, 4, c, g[3 + c]);
        store(out.opacity, group, 1, 0, g[10] / gaussian.opacity);
        for (size_t c = 0; c < sh_size; ++c)
            store(out.sh, group, sh_size, c, g[GEOMETRY + c]);
    });
}

} // namespace INSTRUCTION_SET
