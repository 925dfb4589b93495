// One step of Adam on raw parameters, computed directly from the sums over pixels without storing gradients.
//
// Kingma and Ba 2015. Only Gaussians with a gradient take a step. The bias correction uses each Gaussian's
// own step count, so that a Gaussian that comes into view late starts like the others.
#pragma once

#include "over/gradient.h"

namespace INSTRUCTION_SET {

// log2 of ADAM_BETA1 and ADAM_BETA2.
static_assert(ADAM_BETA1 == 0.9 && ADAM_BETA2 == 0.999);
constexpr double LOG2_BETA1 = -0.15200309344504997, LOG2_BETA2 = -0.0014434168696687174;

// Turns gradients with respect to activated parameters into those with respect to raw parameters.
inline void chain_to_raw(const Gaussian& raw, const Gaussian& activated, Wide* g)
{
    const Vec4& q = activated.rotation;
    const Wide norm = length(raw.rotation);
    const Wide radial = q.x * g[3] + q.y * g[4] + q.z * g[5] + q.w * g[6];
    g[3] = (g[3] - q.x * radial) / norm, g[4] = (g[4] - q.y * radial) / norm;
    g[5] = (g[5] - q.z * radial) / norm, g[6] = (g[6] - q.w * radial) / norm;
    g[7] = g[7] * activated.scale.x, g[8] = g[8] * activated.scale.y, g[9] = g[9] * activated.scale.z;
    g[10] = g[10] * (1.0 - activated.opacity);
}

// The bias corrections of eight Gaussians.
struct Correction {
    Wide mean, root; // 1 / (1 - beta1^t), 1 / sqrt(1 - beta2^t)
};

inline Correction correction_of(const int32_t* steps, const Group& group)
{
    const Wide t = load(steps, group, 1, 0);
    return {1.0 / (1.0 - exp2(max(t * LOG2_BETA1, Wide(-1000)))),
        1.0 / sqrt(1.0 - exp2(max(t * LOG2_BETA2, Wide(-1000))))};
}

struct Column {
    float *value, *mean, *square;
    size_t stride;
    double rate;
};

ALWAYS_INLINE void step_column(
    const Column& c, size_t offset, const Group& group, const Correction& by, Wide gradient, uint32_t lanes)
{
    const Wide mean = load(c.mean, group, c.stride, offset), square = load(c.square, group, c.stride, offset);
    const Wide m = mean + (1 - ADAM_BETA1) * (gradient - mean),
               s = ADAM_BETA2 * square + (1 - ADAM_BETA2) * gradient * gradient;
    const Wide step = c.rate * by.mean * m / (sqrt(s) * by.root + ADAM_EPSILON);
    store(c.mean, group, c.stride, offset, m, lanes), store(c.square, group, c.stride, offset, s, lanes);
    store(c.value, group, c.stride, offset, load(c.value, group, c.stride, offset) - step, lanes);
}

// The lanes without a gradient that is NaN.
inline uint32_t numbers(const Wide* g, size_t parameters)
{
    uint32_t lanes = 0xff;
    for (size_t c = 0; c < parameters; ++c)
        lanes &= bits_of(g[c] <= absolute(g[c]));
    return lanes;
}

// Takes a step on the Gaussians of these lanes whose gradient is not all zero.
inline void step_group(
    const Step& step, const Group& group, const Wide* g, size_t parameters, uint32_t allowed)
{
    uint32_t lanes = 0;
    for (size_t c = 0; c < parameters; ++c)
        lanes |= bits_of(Wide(0) < absolute(g[c]));
    lanes &= allowed;
    for (int lane = 0; lane < group.count; ++lane)
        step.steps[group.index[lane]] += int32_t(lanes >> lane & 1);

    const Correction by = correction_of(step.steps, group);
    const auto &p = step.parameters, &m = step.mean, &s = step.square;
    const size_t sh_size = parameters - GEOMETRY;
    const Column columns[] = {
        {p.position, m.position, s.position, 3, step.rates[0]},
        {p.rotation, m.rotation, s.rotation, 4, step.rates[1]},
        {p.scale, m.scale, s.scale, 3, step.rates[2]},
        {p.opacity, m.opacity, s.opacity, 1, step.rates[3]},
        {p.sh, m.sh, s.sh, sh_size, step.rates[4]},
    };
    for (const Column& column : columns)
        for (size_t offset = 0; offset < column.stride; ++offset)
            step_column(column, offset, group, by, *g++, lanes);
}

// The largest standard deviation of each footprint, px.
inline Wide radius_of(const Footprint<float>* footprints, const Group& group)
{
    double wx[8], wy[8], k[8];
    for (int lane = 0; lane < 8; ++lane) {
        const Footprint<float>& f = footprints[group.index[lane]];
        wx[lane] = f.whiten_x, wy[lane] = f.whiten_y, k[lane] = f.shear;
    }
    const Wide whiten_x = Wide::load(wx), whiten_y = Wide::load(wy), shear = Wide::load(k);
    const Wide yy = 0.5 * LOG2_E / (whiten_y * whiten_y), xy = shear * yy;
    const Wide xx = 0.5 * LOG2_E / (whiten_x * whiten_x) + shear * xy;
    const Wide half = 0.5 * (xx - yy);
    return sqrt(0.5 * (xx + yy) + sqrt(half * half + xy * xy));
}

inline void write_statistics(const Step& step, const Group& group, const Footprint<float>* footprints,
    const float* moments, const FootprintGradient& by)
{
    store(step.contribution, group, 1, 0, load(moments, group, MOMENTS, WEIGHT));
    store(step.error, group, 1, 0, load(moments, group, MOMENTS, ERROR));
    store(step.radius, group, 1, 0, radius_of(footprints, group));
    store(step.mean2d_gradient, group, 1, 0, sqrt(by.mean_x * by.mean_x + by.mean_y * by.mean_y));
}

inline size_t step(const Step& step, const Camera& camera, const Footprint<float>* footprints,
    const uint32_t* keys, const float* moments, size_t begin, size_t end)
{
    for (float* statistic : {step.contribution, step.error, step.radius, step.mean2d_gradient})
        std::memset(statistic + begin, 0, (end - begin) * sizeof(float));
    const auto& p = step.parameters;
    const GaussianArrays<const float> arrays = {
        p.count, p.degree, p.position, p.rotation, p.scale, p.opacity, p.sh};
    const size_t parameters = GEOMETRY + 3 * p.coefficients();
    size_t not_a_number = end;
    for_each_drawn(keys, begin, end, [&](const Group& group) {
        Wide g[PARAMETERS_MAX];
        const Gaussian raw = load_activated(arrays, group), activated = activate(raw);
        const auto by = gradient_of(arrays, activated, group, camera, footprints, moments, g);
        chain_to_raw(raw, activated, g);
        for (size_t c = 0; c < parameters; ++c)
            g[c] = narrow<float>(g[c]);
        const uint32_t lanes = numbers(g, parameters);
        for (int lane = 0; lane < group.count; ++lane)
            if (!(lanes >> lane & 1) && group.index[lane] < not_a_number)
                not_a_number = group.index[lane];
        write_statistics(step, group, footprints, moments, by);
        if (step.update)
            step_group(step, group, g, parameters, lanes);
    });
    return not_a_number;
}

} // namespace INSTRUCTION_SET
