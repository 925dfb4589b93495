#include "over/splat.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>

#include "dispatch.h"
#include "parallel.h"

static_assert(sizeof(Footprint<float>) == 48);

template <class Real>
void Frame<Real>::splat(const GaussianArrays<const Real>& gaussians, const Camera& camera,
    const Blend& operation, Project<Real>* project)
{
    view = camera, blend = operation, count = gaussians.count, coefficients = gaussians.coefficients();
    footprint_buffer.reserve(count), key_buffer.reserve(count);
    parallel_for(count, GRAIN, [&](size_t begin, size_t end) {
        project(gaussians, view, blend, begin, end, footprint_buffer.get(), key_buffer.get());
    });
    order(gaussians.position);

    const size_t pixel_count = size_t(view.width) * view.height;
    radiance.reserve(3 * pixel_count), transmittance.reserve(pixel_count);
    const TileGrid grid = {view.width, view.height};
    lists.count(footprint_buffer.get(), drawn.get(), drawn_count, grid, std::log2(blend.alpha_min),
        band_limit(), 6 * pixel_count);
    std::atomic<size_t> blended{0};
    for (const Band& band : lists.bands()) {
        lists.fill(band);
        parallel_for(band.last - band.first, 1, [&](size_t begin, size_t end) {
            for (size_t i = begin; i < end; ++i)
                blended += splat_kernels<Real>().blend(
                    tile_of(band.first + i), {radiance.get(), transmittance.get()});
        });
    }
    pairs = blended;
}

// Sorts runs of equal keys by depth in double precision, and equal depths by index, so that the Gaussians of
// a wall seen head-on keep their order.
template <class Real>
static void break_ties(Drawn* items, size_t count, const Real* position, const Camera& view)
{
    const auto depth = [&](const Drawn& item) {
        const Real* const p = position + 3 * size_t(item.gaussian);
        const double* const row = view.rotation[2];
        return -(row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + view.translation[2]);
    };
    for (size_t begin = 0, end; begin < count; begin = end) {
        for (end = begin + 1; end < count && items[end].key == items[begin].key; ++end) { }
        if (end - begin > 1)
            std::stable_sort(items + begin, items + end,
                [&](const Drawn& a, const Drawn& b) { return depth(a) < depth(b); });
    }
}

// Lists the drawn Gaussians, front to back.
template <class Real> void Frame<Real>::order(const Real* position)
{
    Drawn* items = drawn.reserve(count);
    drawn_count = 0;
    for (size_t i = 0; i < count; ++i)
        if (keys()[i] != NOT_DRAWN)
            items[drawn_count++] = {keys()[i], uint32_t(i)};

    static_assert(sizeof(Drawn) <= MOMENTS * sizeof(Real));
    auto* const scratch = reinterpret_cast<Drawn*>(sum_buffer.reserve(count * MOMENTS * sizeof(Real)));
    Drawn* const sorted = sort_by_key(items, scratch, drawn_count);
    break_ties(sorted, drawn_count, position, view);
    for (size_t i = 0; i < drawn_count; ++i) {
        const Footprint<Real>& footprint = footprints()[sorted[i].gaussian];
        items[i] = sorted[i];
        items[i].set_rows(footprint.first_row, footprint.last_row);
    }
}

template <class Real> Tile<Real> Frame<Real>::tile_of(size_t index) const
{
    const TileGrid grid = {view.width, view.height};
    const size_t begin = lists.start(0, index), end = lists.start(lists.chunk_count(), index);
    return {footprint_buffer.get(), lists.entries() + begin, end - begin,
        int(index % grid.columns()) * TILE_SIZE, int(index / grid.columns()) * TILE_SIZE, view.width,
        view.height, Real(std::log2(blend.alpha_min)), Real(blend.alpha_max)};
}

template <class Real> void Frame<Real>::sum_moments(const PixelGradients<Real>& by)
{
    Real* const sums = reinterpret_cast<Real*>(sum_buffer.get());
    parallel_for(count, GRAIN,
        [&](size_t begin, size_t end) { std::fill(sums + begin * MOMENTS, sums + end * MOMENTS, Real(0)); });
    for (const Band& band : lists.bands()) {
        lists.fill(band);
        if (band.entry_count > band_limit()) { // a single tile, in which no Gaussian occurs twice
            for (size_t tile = band.first; tile < band.last; ++tile)
                splat_kernels<Real>().blend_backward(tile_of(tile), pixels(), by, {nullptr, sums});
            continue;
        }
        Real* const moments = moment_buffer.reserve(band_limit() * MOMENTS);
        parallel_for(band.last - band.first, 1, [&](size_t begin, size_t end) {
            for (size_t tile = band.first + begin; tile < band.first + end; ++tile)
                splat_kernels<Real>().blend_backward(tile_of(tile), pixels(), by,
                    {moments + (lists.start(0, tile) - lists.start(0, band.first)) * MOMENTS, nullptr});
        });
        add_moments(band);
    }
}

// Adds the moments of one band, tile by tile. Chunks run in parallel because they share no Gaussian.
template <class Real> void Frame<Real>::add_moments(const Band& band)
{
    Real* const sums = reinterpret_cast<Real*>(sum_buffer.get());
    parallel_for(lists.chunk_count(), 1, [&](size_t chunk, size_t) {
        const size_t first = lists.start(0, band.first);
        for (size_t tile = band.first; tile < band.last; ++tile) {
            const size_t end = lists.start(chunk + 1, tile);
            for (size_t k = lists.start(chunk, tile); k < end; ++k) {
                __builtin_prefetch(sums + size_t(lists.entries()[std::min(k + 8, end - 1)]) * MOMENTS);
                Real* const sum = sums + size_t(lists.entries()[k]) * MOMENTS;
                const Real* const added = moment_buffer.get() + (k - first) * MOMENTS;
                for (int m = 0; m < MOMENTS; ++m)
                    sum[m] += added[m];
            }
        }
    });
}

template <class Real> int64_t Frame<Real>::first_not_finite() const
{
    std::atomic<size_t> first{count};
    parallel_for(count, GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
            const Real* const sum = sums() + i * MOMENTS;
            if (keys()[i] == NOT_DRAWN ||
                std::all_of(sum, sum + MOMENTS, [](Real s) { return std::isfinite(s); }))
                continue;
            lower(first, i);
            return;
        }
    });
    return first < count ? int64_t(first) : -1;
}

template <class Real>
void Frame<Real>::gradients(
    const GaussianArrays<const Real>& gaussians, const GaussianArrays<Real>& gradient) const
{
    parallel_for(count, GRAIN, [&](size_t begin, size_t end) {
        splat_kernels<Real>().gradients(gaussians, view, footprints(), keys(), sums(), begin, end, gradient);
    });
}

template <class Real> bool Frame<Real>::is_of(const GaussianArrays<const Real>& gaussians) const
{
    return gaussians.count == count && gaussians.coefficients() == coefficients;
}

template <class Real> size_t Frame<Real>::byte_count() const
{
    return footprint_buffer.byte_count() + key_buffer.byte_count() + drawn.byte_count() +
        sum_buffer.byte_count() + lists.byte_count() + moment_buffer.byte_count() + radiance.byte_count() +
        transmittance.byte_count();
}

template class Frame<float>;
template class Frame<double>;
