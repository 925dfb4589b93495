#include "surface/field.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "dispatch.h"
#include "lib/constants.glsl"
#include "parallel.h"

namespace {

constexpr size_t PREPARE_GRAIN = 1024, GAUSSIAN_GRAIN = 64; // grain sizes of loops
constexpr size_t RUN = 32; // consecutive blocks that one thread reads; their rows stay in its cache meanwhile

// The bounding boxes of `count` groups of lanes, the i-th from low(i, axis) to high(i, axis).
template <class Real, class Low, class High>
std::vector<Boxes<Real>> boxes_of(size_t count, Low low, High high)
{
    constexpr Real NOWHERE = std::numeric_limits<Real>::infinity();
    std::vector<Boxes<Real>> boxes((count + FIELD_LANES - 1) / FIELD_LANES);
    for (size_t i = 0; i < boxes.size() * FIELD_LANES; ++i)
        for (int axis = 0; axis < 3; ++axis) {
            Boxes<Real>& to = boxes[i / FIELD_LANES];
            const Real *const l = i < count ? low(i, axis) : nullptr,
                              *const h = i < count ? high(i, axis) : nullptr;
            to.low[axis][i % FIELD_LANES] = l ? *std::min_element(l, l + FIELD_LANES) : NOWHERE;
            to.high[axis][i % FIELD_LANES] = h ? *std::max_element(h, h + FIELD_LANES) : -NOWHERE;
        }
    return boxes;
}

template <class Real> PreparedGaussian<Real> prepared_gaussian(const FieldArrays<Real>& a, size_t i)
{
    const Real x = a.rotation[4 * i], y = a.rotation[4 * i + 1], z = a.rotation[4 * i + 2],
               w = a.rotation[4 * i + 3];
    // The axes are the columns of the rotation matrix.
    PreparedGaussian<Real> r = {{},
        {{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)},
            {2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)},
            {2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)}},
        {}, a.opacity[i], {}, {}};
    for (int axis = 0; axis < 3; ++axis) {
        r.position[axis] = a.position[3 * i + axis];
        r.inverse_scale[axis] = 1 / std::clamp(a.scale[3 * i + axis], Real(SCALE_MIN), Real(SCALE_MAX));
        r.tint[axis] = Real(SH_C0) * a.tint[a.tint_stride * i + axis];
    }
    for (size_t j = 0; j < a.slopes; ++j)
        r.slope[j] = a.slope[2 * i + j];
    return r;
}

// The values at a block's points; those of unused lanes are 0.
template <class Real> struct BlockValues {
    alignas(64) Real value[3 * FIELD_LANES] = {};

    BlockValues(const Real* values, size_t columns, size_t first, size_t count)
    {
        std::copy_n(values + columns * first, columns * count, value);
    }
};

// The blocks of a run that a Gaussian reaches, as bits, and the row that they share.
struct Touched {
    uint32_t gaussian, row, run, blocks;
};

} // namespace

template <class Real>
Field<Real>::Field(size_t count, const Real* position, const Real* normal, const Real* bend)
    : points(count)
    , blocks((count + FIELD_LANES - 1) / FIELD_LANES)
    , first_row(1)
    , first_in_block(blocks.size() + 1)
{
    for (size_t b = 0; b < blocks.size(); ++b)
        for (size_t lane = 0; lane < FIELD_LANES; ++lane) {
            const size_t i = std::min(b * FIELD_LANES + lane, count - 1);
            for (int axis = 0; axis < 3; ++axis) {
                blocks[b].position[axis][lane] = position[3 * i + axis];
                blocks[b].normal[axis][lane] = b * FIELD_LANES + lane < count ? normal[3 * i + axis] : 0;
                blocks[b].bend[axis][lane] = bend ? bend[3 * i + axis] : 0;
            }
        }
    const auto position_of = [&](size_t i, int axis) { return blocks[i].position[axis]; };
    levels.push_back(boxes_of<Real>(blocks.size(), position_of, position_of));
    while (levels.back().size() > 1) {
        const std::vector<Boxes<Real>>& below = levels.back();
        levels.push_back(boxes_of<Real>(
            below.size(), [&](size_t i, int axis) { return below[i].low[axis]; },
            [&](size_t i, int axis) { return below[i].high[axis]; }));
    }
}

// Calls visit(block, lanes), in ascending order, for the blocks that a Gaussian `margin` times as large would
// reach, with the lanes that it would reach there as bits.
template <class Real>
template <class Visit>
void Field<Real>::visit_touched(
    const PreparedGaussian<Real>& gaussian, const FieldBlend& blend, double margin, Visit&& visit) const
{
    constexpr Real BEYOND = std::numeric_limits<Real>::infinity();
    const double radius = std::sqrt(-2 * std::log(blend.cutoff));
    PreparedGaussian<Real> larger = gaussian;
    for (Real& s : larger.inverse_scale)
        s = Real(s / margin);
    Real low[3], high[3];
    for (int axis = 0; axis < 3; ++axis) {
        double square = 0;
        for (int i = 0; i < 3; ++i)
            square += std::pow(larger.axes[i][axis] / larger.inverse_scale[i], 2);
        const double half = radius * std::sqrt(square);
        low[axis] = std::nextafter(Real(larger.position[axis] - half), -BEYOND);
        high[axis] = std::nextafter(Real(larger.position[axis] + half), BEYOND);
    }
    const FieldKernels<Real>& kernels = field_kernels<Real>();
    const auto descend = [&](const auto& self, size_t level, size_t group) -> void {
        for (uint32_t in = kernels.overlaps(levels[level][group], low, high); in; in &= in - 1) {
            const size_t i = group * FIELD_LANES + std::countr_zero(in);
            if (level > 0)
                self(self, level - 1, i);
            else if (const uint32_t lanes = kernels.touches(larger, blocks[i], blend))
                visit(i, lanes);
        }
    };
    if (!blocks.empty())
        descend(descend, levels.size() - 1, 0);
}

template <class Real> void Field<Real>::prepare(const FieldArrays<Real>& gaussians)
{
    prepared_gaussians.reserve(gaussians.count);
    parallel_for(gaussians.count, PREPARE_GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i)
            prepared_gaussians.get()[i] = prepared_gaussian(gaussians, i);
    });
}

template <class Real>
void Field<Real>::list(const FieldArrays<Real>& gaussians, const FieldBlend& operation, double margin)
{
    blend = operation;
    prepare(gaussians);
    std::vector<std::vector<Touched>> parts((gaussians.count + GAUSSIAN_GRAIN - 1) / GAUSSIAN_GRAIN);
    first_row.assign(gaussians.count + 1, 0);
    parallel_for(gaussians.count, GAUSSIAN_GRAIN, [&](size_t begin, size_t end) {
        std::vector<Touched>& part = parts[begin / GAUSSIAN_GRAIN];
        for (size_t i = begin; i < end; ++i) {
            const size_t before = part.size();
            visit_touched(prepared_gaussians.get()[i], blend, margin, [&](size_t b, uint32_t) {
                if (part.size() == before || part.back().run != b / RUN)
                    part.push_back({uint32_t(i), 0, uint32_t(b / RUN), 0});
                part.back().blocks |= 1u << b % RUN;
            });
            first_row[i + 1] = part.size() - before;
        }
    });
    std::partial_sum(first_row.begin(), first_row.end(), first_row.begin());

    const size_t runs = (blocks.size() + RUN - 1) / RUN;
    std::vector<size_t> first_in_run(runs + 1), entries_before(runs + 1);
    for (const std::vector<Touched>& part : parts)
        for (const Touched& touched : part) {
            ++first_in_run[touched.run + 1];
            entries_before[touched.run + 1] += std::popcount(touched.blocks);
        }
    std::partial_sum(first_in_run.begin(), first_in_run.end(), first_in_run.begin());
    std::partial_sum(entries_before.begin(), entries_before.end(), entries_before.begin());
    std::vector<Touched> by_run(first_row.back());
    std::vector<size_t> next(first_in_run.begin(), first_in_run.end() - 1);
    uint32_t row = 0;
    for (std::vector<Touched>& part : parts)
        for (Touched& touched : part) {
            touched.row = row++;
            by_run[next[touched.run]++] = touched;
        }

    entries.resize(entries_before.back());
    first_in_block.back() = entries.size();
    parallel_for(runs, 1, [&](size_t run, size_t) {
        const std::span touching(by_run.data() + first_in_run[run], by_run.data() + first_in_run[run + 1]);
        size_t next_entry[RUN + 1] = {entries_before[run]};
        for (const Touched& touched : touching)
            for (size_t b = 0; b < RUN; ++b)
                next_entry[b + 1] += touched.blocks >> b & 1;
        std::partial_sum(next_entry, next_entry + RUN + 1, next_entry);
        std::copy_n(next_entry, std::min(RUN, blocks.size() - run * RUN), &first_in_block[run * RUN]);
        for (const Touched& touched : touching) {
            const int first = std::countr_zero(touched.blocks);
            for (uint32_t left = touched.blocks; left; left &= left - 1) {
                const int b = std::countr_zero(left);
                entries[next_entry[b]++] = {touched.gaussian, touched.row, b == first};
            }
        }
    });
}

template <class Real>
std::vector<ReachedPoint> Field<Real>::reached(const FieldArrays<Real>& gaussians,
    const FieldBlend& operation, double margin, const Real* values, const Real* low, const Real* high)
{
    prepare(gaussians);
    std::vector<std::vector<ReachedPoint>> parts((gaussians.count + GAUSSIAN_GRAIN - 1) / GAUSSIAN_GRAIN);
    parallel_for(gaussians.count, GAUSSIAN_GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i)
            visit_touched(prepared_gaussians.get()[i], operation, margin, [&](size_t block, uint32_t lanes) {
                for (; lanes; lanes &= lanes - 1) {
                    const size_t point = block * FIELD_LANES + std::countr_zero(lanes);
                    bool differs = false;
                    for (int c = 0; c < 3; ++c)
                        differs |=
                            values[3 * point + c] < low[3 * i + c] || values[3 * point + c] > high[3 * i + c];
                    if (differs)
                        parts[begin / GAUSSIAN_GRAIN].push_back({uint32_t(i), uint32_t(point)});
                }
            });
    });
    std::vector<ReachedPoint> all;
    for (const std::vector<ReachedPoint>& part : parts)
        all.insert(all.end(), part.begin(), part.end());
    return all;
}

// Calls body(reading, first point, number of points) for all blocks.
template <class Real>
template <class Body>
void Field<Real>::for_each_block(const FieldArrays<Real>& gaussians, Body&& body)
{
    prepare(gaussians);
    parallel_for(blocks.size(), RUN, [&](size_t begin, size_t end) {
        for (size_t b = begin; b < end; ++b) {
            const size_t first = b * FIELD_LANES;
            const BlockReading<Real> reading = {&blocks[b], entries.data() + first_in_block[b],
                first_in_block[b + 1] - first_in_block[b], prepared_gaussians.get(), gaussians.sh,
                gaussians.coefficients, gaussians.slopes, blend};
            body(reading, first, std::min(size_t(FIELD_LANES), points - first));
        }
    });
}

template <class Real> void Field<Real>::read(const FieldArrays<Real>& gaussians, Real* sums)
{
    for_each_block(gaussians, [&](const BlockReading<Real>& reading, size_t first, size_t count) {
        Real local[4 * FIELD_LANES];
        field_kernels<Real>().read(reading, local);
        std::copy_n(local, 4 * count, sums + 4 * first);
    });
}

// Sums each Gaussian's rows, in the order of the blocks, and writes them to (gaussians, columns).
template <class Real> void Field<Real>::sum_rows(size_t gaussians, size_t columns, Real* to) const
{
    parallel_for(gaussians, GAUSSIAN_GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i)
            field_kernels<Real>().sum_rows(rows.get() + first_row[i] * field_stride(columns),
                first_row[i + 1] - first_row[i], columns, to + i * columns);
    });
}

template <class Real>
void Field<Real>::backward(const FieldArrays<Real>& gaussians, const Real* light, const Real* by_light,
    const Real* inverse_weight, Real* derivatives)
{
    rows.reserve(first_row.back() * field_stride(FIELD_DERIVATIVES));
    for_each_block(gaussians, [&](const BlockReading<Real>& reading, size_t first, size_t count) {
        const BlockValues<Real> l(light, 3, first, count), by(by_light, 3, first, count),
            inverse(inverse_weight, 1, first, count);
        field_kernels<Real>().read_backward(reading, l.value, by.value, inverse.value, rows.get());
    });
    sum_rows(gaussians.count, FIELD_DERIVATIVES, derivatives);
}

template <class Real>
void Field<Real>::transposed(
    const FieldArrays<Real>& gaussians, const Real* values, const Real* inverse_weight, Real* transposed)
{
    const size_t columns = 3 * gaussians.coefficients + gaussians.slopes;
    rows.reserve(first_row.back() * field_stride(columns));
    for_each_block(gaussians, [&](const BlockReading<Real>& reading, size_t first, size_t count) {
        const BlockValues<Real> v(values, 3, first, count), inverse(inverse_weight, 1, first, count);
        field_kernels<Real>().transposed(reading, v.value, inverse.value, rows.get());
    });
    sum_rows(gaussians.count, columns, transposed);
}

template <class Real>
void Field<Real>::normal(const FieldArrays<Real>& gaussians, const Real* weights, const Real* inverse_weight,
    bool free, Real* products)
{
    const size_t columns = 3 * gaussians.coefficients + (free ? gaussians.slopes : 0);
    rows.reserve(first_row.back() * field_stride(columns));
    for_each_block(gaussians, [&](const BlockReading<Real>& reading, size_t first, size_t count) {
        thread_local Buffer<Real> kept;
        const BlockValues<Real> w(weights, 1, first, count), inverse(inverse_weight, 1, first, count);
        field_kernels<Real>().normal(reading, w.value, inverse.value, free,
            kept.reserve(reading.list_length * FIELD_KEPT * FIELD_LANES), rows.get());
    });
    sum_rows(gaussians.count, columns, products);
}

template class Field<float>;
template class Field<double>;
