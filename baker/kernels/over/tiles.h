// Lists the Gaussians that touch each tile of the image, front to back, one band of tiles at a time.
#pragma once

#include <cstdint>
#include <vector>

#include "buffer.h"
#include "over/records.h"
#include "over/sort.h"

struct TileGrid {
    int width, height; // px

    int columns() const { return (width + TILE_SIZE - 1) / TILE_SIZE; }
    int rows() const { return (height + TILE_SIZE - 1) / TILE_SIZE; }
    size_t count() const { return size_t(columns()) * rows(); }
};

// Tiles [first, last), row by row.
struct Band {
    size_t first, last;
    size_t entry_count;
};

// The work is divided into bands of tiles, which bounds the memory for entries with Gaussians of any size,
// and into chunks of Gaussians consecutive in depth. Neither division depends on the number of threads.
template <class Real> class TileLists {
public:
    // Divides the image into bands of at most `band_limit` entries, or a single tile. If there are at most
    // `list_limit` entries in total, all are listed at once; otherwise the lists hold one band at a time.
    // `drawn` (count,) is front to back.
    void count(const Footprint<Real>* footprints, const Drawn* drawn, size_t count, const TileGrid& grid,
        double log2_alpha_min, size_t band_limit, size_t list_limit);
    // Lists one band, unless it is listed already.
    void fill(const Band& band);

    const std::vector<Band>& bands() const { return band_list; }
    size_t chunk_count() const { return chunks; }
    size_t entry_count() const { return total; }
    const uint32_t* entries() const { return entry_buffer.get(); } // indices of Gaussians
    // Start of a chunk's part of a tile's list. For chunk_count() it is the end of the list.
    uint32_t start(size_t chunk, size_t tile) const { return starts.get()[chunk * grid.count() + tile]; }
    size_t byte_count() const { return starts.byte_count() + entry_buffer.byte_count(); }

private:
    TileSearch<Real> search(size_t chunk, const Band& band) const;
    void cut_into_bands(size_t band_limit);
    void number_entries(const Band& band);
    Band image() const { return {0, grid.count(), total}; }

    const Footprint<Real>* footprints = nullptr;
    const Drawn* drawn = nullptr;
    size_t drawn_count = 0, chunks = 0, chunk_size = 0;
    TileGrid grid = {};
    double log2_alpha_min = 0;
    std::vector<Band> band_list;
    size_t total = 0;        // number of entries in the image
    Band listed = {};        // empty if nothing is listed
    Buffer<uint32_t> starts; // (chunks + 1, tiles), indices into the entries listed together
    Buffer<uint32_t> entry_buffer;
};
