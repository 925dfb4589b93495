#include "surface/field.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "dispatch.h"
#include "lib/constants.glsl"
#include "parallel.h"

namespace {

constexpr size_t FAN = 8; // boxes of one level per box of the next
constexpr size_t PREPARE_GRAIN = 1024, GAUSSIAN_GRAIN = 64, BLOCK_GRAIN = 32,
                 POINT_GRAIN = 4096; // grain sizes of loops

template <class Real> Box box_of(const PointBlock<Real>& block)
{
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
        const auto [low, high] =
            std::minmax_element(block.position[axis], block.position[axis] + FIELD_LANES);
        box.low[axis] = *low, box.high[axis] = *high;
    }
    return box;
}

Box united(const Box* boxes, size_t count)
{
    Box all = boxes[0];
    for (size_t i = 1; i < count; ++i)
        for (int axis = 0; axis < 3; ++axis) {
            all.low[axis] = std::min(all.low[axis], boxes[i].low[axis]);
            all.high[axis] = std::max(all.high[axis], boxes[i].high[axis]);
        }
    return all;
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

} // namespace

template <class Real>
Field<Real>::Field(size_t count, const Real* position, const Real* normal, const Real* bend)
    : points(count)
    , blocks((count + FIELD_LANES - 1) / FIELD_LANES)
    , first_entry(1)
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
    levels.emplace_back(blocks.size());
    std::transform(blocks.begin(), blocks.end(), levels[0].begin(), box_of<Real>);
    while (levels.back().size() > FAN) {
        const std::vector<Box>& below = levels.back();
        std::vector<Box> level((below.size() + FAN - 1) / FAN);
        for (size_t i = 0; i < level.size(); ++i)
            level[i] = united(&below[FAN * i], std::min(FAN, below.size() - FAN * i));
        levels.push_back(std::move(level));
    }
}

// Calls visit(block, lanes), in ascending order, for the blocks that a Gaussian `margin` times as large would
// reach, with the lanes that it would reach there as bits.
template <class Real>
template <class Visit>
void Field<Real>::visit_touched(
    const PreparedGaussian<Real>& gaussian, const FieldBlend& blend, double margin, Visit&& visit) const
{
    const double radius = std::sqrt(-2 * std::log(blend.cutoff));
    double low[3], high[3];
    for (int axis = 0; axis < 3; ++axis) {
        double square = 0;
        for (int i = 0; i < 3; ++i)
            square += std::pow(gaussian.axes[i][axis] / gaussian.inverse_scale[i], 2);
        const double half = radius * margin * std::sqrt(square);
        low[axis] = gaussian.position[axis] - half, high[axis] = gaussian.position[axis] + half;
    }
    const auto descend = [&](const auto& self, size_t level, size_t first, size_t last) -> void {
        for (size_t i = first; i < last; ++i) {
            const Box& box = levels[level][i];
            bool apart = false;
            for (int axis = 0; axis < 3; ++axis)
                apart = apart || box.low[axis] > high[axis] || box.high[axis] < low[axis];
            if (apart)
                continue;
            if (level > 0)
                self(self, level - 1, FAN * i, std::min(FAN * (i + 1), levels[level - 1].size()));
            else if (const uint32_t lanes = field_kernels<Real>().touches(gaussian, blocks[i], blend, margin))
                visit(i, lanes);
        }
    };
    descend(descend, levels.size() - 1, 0, levels.back().size());
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
    first_entry.assign(gaussians.count + 1, 0);
    std::vector<std::vector<uint32_t>> touched((gaussians.count + GAUSSIAN_GRAIN - 1) / GAUSSIAN_GRAIN);
    parallel_for(gaussians.count, GAUSSIAN_GRAIN, [&](size_t begin, size_t end) {
        std::vector<uint32_t>& found = touched[begin / GAUSSIAN_GRAIN];
        for (size_t i = begin; i < end; ++i) {
            const size_t before = found.size();
            visit_touched(prepared_gaussians.get()[i], blend, margin,
                [&](size_t b, uint32_t) { found.push_back(uint32_t(b)); });
            first_entry[i + 1] = found.size() - before;
        }
    });
    for (size_t i = 0; i < gaussians.count; ++i)
        first_entry[i + 1] += first_entry[i];
    std::vector<uint32_t> block_of;
    block_of.reserve(first_entry.back());
    for (const std::vector<uint32_t>& found : touched)
        block_of.insert(block_of.end(), found.begin(), found.end());
    first_in_block.assign(blocks.size() + 1, 0);
    for (uint32_t b : block_of)
        ++first_in_block[b + 1];
    for (size_t b = 0; b < blocks.size(); ++b)
        first_in_block[b + 1] += first_in_block[b];
    std::vector<size_t> next(first_in_block.begin(), first_in_block.end() - 1);
    entries.resize(block_of.size());
    for (size_t i = 0; i < gaussians.count; ++i)
        for (size_t entry = first_entry[i]; entry < first_entry[i + 1]; ++entry)
            entries[next[block_of[entry]]++] = {uint32_t(i), uint32_t(entry)};
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
    parallel_for(blocks.size(), BLOCK_GRAIN, [&](size_t begin, size_t end) {
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

// Sums each Gaussian's rows of by_entry, in the order of the blocks, and writes them to (gaussians, columns).
template <class Real> void Field<Real>::sum_entries(size_t gaussians, size_t columns, Real* to) const
{
    parallel_for(gaussians, GAUSSIAN_GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i)
            field_kernels<Real>().sum_rows(by_entry.get() + first_entry[i] * columns,
                first_entry[i + 1] - first_entry[i], columns, to + i * columns);
    });
}

template <class Real>
void Field<Real>::backward(const FieldArrays<Real>& gaussians, const Real* light, const Real* by_light,
    const Real* inverse_weight, Real* derivatives)
{
    by_entry.reserve(entries.size() * FIELD_DERIVATIVES);
    for_each_block(gaussians, [&](const BlockReading<Real>& reading, size_t first, size_t count) {
        const BlockValues<Real> l(light, 3, first, count), by(by_light, 3, first, count),
            inverse(inverse_weight, 1, first, count);
        field_kernels<Real>().read_backward(reading, l.value, by.value, inverse.value, by_entry.get());
    });
    sum_entries(gaussians.count, FIELD_DERIVATIVES, derivatives);
}

template <class Real>
void Field<Real>::transposed(
    const FieldArrays<Real>& gaussians, const Real* values, const Real* inverse_weight, Real* transposed)
{
    const size_t columns = 3 * gaussians.coefficients + gaussians.slopes;
    by_entry.reserve(entries.size() * columns);
    for_each_block(gaussians, [&](const BlockReading<Real>& reading, size_t first, size_t count) {
        const BlockValues<Real> v(values, 3, first, count), inverse(inverse_weight, 1, first, count);
        field_kernels<Real>().transposed(reading, v.value, inverse.value, by_entry.get());
    });
    sum_entries(gaussians.count, columns, transposed);
}

template <class Real>
void Field<Real>::normal(const FieldArrays<Real>& gaussians, const Real* weights, const Real* inverse_weight,
    bool free, Real* products)
{
    const size_t columns = 3 * gaussians.coefficients + (free ? gaussians.slopes : 0);
    by_entry.reserve(entries.size() * columns);
    for_each_block(gaussians, [&](const BlockReading<Real>& reading, size_t first, size_t count) {
        thread_local Buffer<Real> kept;
        const BlockValues<Real> w(weights, 1, first, count), inverse(inverse_weight, 1, first, count);
        field_kernels<Real>().normal(reading, w.value, inverse.value, free,
            kept.reserve(reading.list_length * FIELD_KEPT * FIELD_LANES), by_entry.get());
    });
    sum_entries(gaussians.count, columns, products);
}

void fill_gap(size_t count, const float* sums, const float* coarse, float floor, float* light, float* inverse,
    float* yielding)
{
    parallel_for(count, POINT_GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
            const float weight = sums[4 * i + 3], gap = std::max(floor - weight, 0.0f), all = weight + gap;
            inverse[i] = all >= std::numeric_limits<float>::min() ? 1 / all : 0;
            for (size_t c = 0; c < 3; ++c) {
                const size_t j = 3 * i + c;
                light[j] = (sums[4 * i + c] + gap * coarse[j]) * inverse[i];
                yielding[j] = weight < floor ? coarse[j] : light[j];
            }
        }
    });
}

template class Field<float>;
template class Field<double>;
