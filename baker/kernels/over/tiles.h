// Which Gaussians touch which tile of the image, front to back, a band of tiles at a time.
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

// Tiles [first, last), in rows.
struct Band {
    size_t first, last;
    size_t entry_count;
};

// Work is cut into bands of tiles, so that what is kept per entry is bounded whatever the Gaussians' size,
// and into chunks of Gaussians that follow each other in depth. Neither depends on the number of threads.
template <class Real> class TileLists {
public:
    // `drawn` (count,) front to back. Cuts the image into bands of at most `band_limit` entries, or one tile.
    // Where all entries are at most `list_limit`, they are listed at once; otherwise the lists hold one band
    // at a time.
    void count(const Footprint<Real>* footprints, const Drawn* drawn, size_t count, const TileGrid& grid,
        double log2_alpha_min, size_t band_limit, size_t list_limit);
    // Lists one band, unless it is listed already.
    void fill(const Band& band);

    const std::vector<Band>& bands() const { return band_list; }
    size_t chunk_count() const { return chunks; }
    size_t entry_count() const { return total; }
    const uint32_t* entries() const { return entry_buffer.get(); } // Gaussians
    // Where a chunk's part of a tile's list begins; that of chunk_count() is where the list ends.
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
    size_t total = 0;        // entries of the image
    Band listed = {};        // empty where nothing is
    Buffer<uint32_t> starts; // (chunks + 1, tiles), into the entries that are listed together
    Buffer<uint32_t> entry_buffer;
};
