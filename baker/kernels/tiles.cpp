#include "tiles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "parallel.h"

static constexpr size_t CHUNKS_MAX = 32; // counters take 4 bytes per chunk and tile: half a byte per pixel
static constexpr size_t CHUNK_SIZE_MIN = 512; // Gaussians

namespace {

// The ellipse within which alpha >= alpha_min, a little larger against rounding.
struct Ellipse {
    double mean_x, mean_y, shear, inverse_whiten_x, whiten_y, reach;
    double apex; // the offset in y at which it extends furthest to the right

    template <class Real>
    Ellipse(const Footprint<Real>& f, double log2_alpha_min)
        : mean_x(f.mean_x)
        , mean_y(f.mean_y)
        , shear(f.shear)
        , inverse_whiten_x(1.0 / f.whiten_x)
        , whiten_y(f.whiten_y)
        , reach((f.log2_opacity - log2_alpha_min) * 1.001 + 1e-4)
    {
        const double slope = shear * f.whiten_x / whiten_y;
        apex = slope / whiten_y * std::sqrt(reach / (1 + slope * slope));
    }

    // How far to the right of the mean it extends within [low, high], offsets in y from the mean. The edge is
    // concave in y: where its apex lies outside, the nearest row inside extends furthest.
    double extent(double low, double high, double sign) const
    {
        const double dy = std::min(std::max(sign * apex, low), high), v = whiten_y * dy;
        return sign * shear * dy + std::sqrt(std::max(0.0, reach - v * v)) * inverse_whiten_x;
    }
};

} // namespace

// Calls visit(tile) for the tiles of the band that the chunk's Gaussians touch.
template <class Real>
template <class Visit>
void TileLists<Real>::for_each_tile(size_t chunk, const Band& band, Visit&& visit) const
{
    const int columns = grid.columns();
    const int first_row = int(band.first / columns), last_row = int((band.last - 1) / columns);
    const size_t end = std::min(drawn_count, (chunk + 1) * chunk_size);
    for (size_t i = chunk * chunk_size; i < end; ++i) {
        if (drawn[i].last_row() < first_row || drawn[i].first_row() > last_row)
            continue;
        if (i + 8 < end)
            __builtin_prefetch(&footprints[drawn[i + 8].gaussian]);
        const Ellipse ellipse(footprints[drawn[i].gaussian], log2_alpha_min);
        const int begin_row = std::max(drawn[i].first_row(), first_row);
        const int end_row = std::min(drawn[i].last_row(), last_row) + 1;
        for (int row = begin_row; row < end_row; ++row) {
            const double low = row * TILE_SIZE + 0.5 - ellipse.mean_y, high = low + (TILE_SIZE - 1);
            const double left = ellipse.mean_x - ellipse.extent(low, high, -1) - 0.5;
            const double right = ellipse.mean_x + ellipse.extent(low, high, 1) - 0.5;
            if (!(right >= 0 && left <= grid.width - 1))
                continue;
            const size_t first = left > 0 ? size_t(left + 0.9999) / TILE_SIZE : 0;
            const size_t last = size_t(std::min(right, grid.width - 1.0)) / TILE_SIZE;
            const size_t row_start = size_t(row) * columns;
            for (size_t tile = std::max(row_start + first, band.first);
                tile <= row_start + last && tile < band.last; ++tile)
                visit(i, tile);
        }
    }
}

template <class Real>
void TileLists<Real>::count(const Footprint<Real>* footprints_in, const Drawn* drawn_in, size_t count,
    const TileGrid& grid_in, double log2_alpha_min_in, size_t band_limit, size_t list_limit)
{
    footprints = footprints_in, drawn = drawn_in, drawn_count = count, grid = grid_in;
    log2_alpha_min = log2_alpha_min_in;
    chunk_size = std::max(CHUNK_SIZE_MIN, (count + CHUNKS_MAX - 1) / CHUNKS_MAX);
    chunks = (count + chunk_size - 1) / chunk_size;
    uint32_t* const counts = starts.reserve((chunks + 1) * grid.count());
    parallel_for(chunks + 1, 1, [&](size_t chunk, size_t) {
        uint32_t* const of_chunk = counts + chunk * grid.count();
        std::fill(of_chunk, of_chunk + grid.count(), 0);
        if (chunk < chunks)
            for_each_tile(chunk, image(), [&](size_t, size_t tile) { ++of_chunk[tile]; });
    });
    cut_into_bands(band_limit);
    if (total <= list_limit)
        number_entries(image());
    else
        for (const Band& band : band_list)
            number_entries(band);
    listed = {};
    if (total <= list_limit)
        fill(image());
}

template <class Real> void TileLists<Real>::cut_into_bands(size_t band_limit)
{
    band_list.clear();
    total = 0;
    Band band = {0, 0, 0};
    for (size_t tile = 0; tile < grid.count(); ++tile) {
        size_t in_tile = 0;
        for (size_t chunk = 0; chunk < chunks; ++chunk)
            in_tile += start(chunk, tile);
        if (band.entry_count > 0 && band.entry_count + in_tile > band_limit) {
            band_list.push_back(band);
            band = {tile, tile, 0};
        }
        band = {band.first, tile + 1, band.entry_count + in_tile};
        total += in_tile;
    }
    band_list.push_back(band);
}

// Turns the counts of a band's tiles into starts.
template <class Real> void TileLists<Real>::number_entries(const Band& band)
{
    uint32_t next = 0;
    for (size_t tile = band.first; tile < band.last; ++tile)
        for (size_t chunk = 0; chunk <= chunks; ++chunk)
            next += std::exchange(starts.get()[chunk * grid.count() + tile], next);
}

template <class Real> void TileLists<Real>::fill(const Band& band)
{
    if (listed.first <= band.first && band.last <= listed.last)
        return;
    listed = band;
    uint32_t* const entries = entry_buffer.reserve(band.entry_count);
    parallel_for(chunks, 1, [&](size_t chunk, size_t) {
        std::vector<uint32_t> next(&starts.get()[chunk * grid.count() + band.first],
            &starts.get()[chunk * grid.count() + band.last]);
        for_each_tile(chunk, band,
            [&](size_t i, size_t tile) { entries[next[tile - band.first]++] = drawn[i].gaussian; });
    });
}

template class TileLists<float>;
template class TileLists<double>;
