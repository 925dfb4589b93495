#include "over/tiles.h"

#include <algorithm>
#include <utility>

#include "dispatch.h"
#include "parallel.h"

static constexpr size_t CHUNKS_MAX = 32; // counters take 4 bytes per chunk and tile: half a byte per pixel
static constexpr size_t CHUNK_SIZE_MIN = 512; // Gaussians

// The search for the tiles of a band that a chunk's Gaussians touch.
template <class Real> TileSearch<Real> TileLists<Real>::search(size_t chunk, const Band& band) const
{
    return {footprints, drawn + chunk * chunk_size, drawn + std::min(drawn_count, (chunk + 1) * chunk_size),
        band.first, band.last, grid.columns(), grid.width, log2_alpha_min};
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
            splat_kernels<Real>().count_tiles(search(chunk, image()), of_chunk);
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

// Turns the counts of a band's tiles into the starts of their lists.
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
        splat_kernels<Real>().list_tiles(search(chunk, band), next.data(), entries);
    });
}

template class TileLists<float>;
template class TileLists<double>;
