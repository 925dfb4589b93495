// Which Gaussians touch which tile of the image, front to back.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "constants.glsl"
#include "projection.h"

// One Gaussian in one tile. Slots number the entries Gaussian by Gaussian, so that what the tiles find out
// about a Gaussian lies side by side.
struct Entry {
    uint32_t gaussian;
    uint32_t slot;
};

struct TileGrid {
    int width, height; // px

    int columns() const { return (width + TILE_SIZE - 1) / TILE_SIZE; }
    int rows() const { return (height + TILE_SIZE - 1) / TILE_SIZE; }
    size_t count() const { return size_t(columns()) * rows(); }
};

struct TileLists {
    std::vector<Entry> entries;     // tile by tile, each front to back
    std::vector<size_t> tile_start; // (tiles + 1,) into entries
    std::vector<size_t> slot_start; // (Gaussians + 1,)
};

// Inclusive range of pixels; empty where last < first.
struct PixelRange {
    int first, last;
};

// Pixels of [0, count) whose centres lie in [low, high].
inline PixelRange pixels_between(double low, double high, int count)
{
    return {int(std::clamp(std::ceil(low - 0.5), 0.0, double(count))),
        int(std::clamp(std::floor(high - 0.5), -1.0, count - 1.0))};
}

// Rows of the image in which alpha >= alpha_min somewhere.
inline PixelRange rows_of(const Footprint& footprint, int height)
{
    const double half = std::sqrt(footprint.reach) / footprint.whiten_y;
    return pixels_between(footprint.mean_y - half, footprint.mean_y + half, height);
}

// How far to the right of the mean alpha >= alpha_min extends within [low, high], offsets in y from the mean.
// The ellipse's edge is concave in y: where its widest row lies outside, the nearest row inside is the
// widest.
inline double extent_right(
    const Footprint& footprint, double low, double high, double shear, double widest_dy)
{
    const double dy = std::clamp(widest_dy, low, high), v = footprint.whiten_y * dy;
    return shear * dy + std::sqrt(std::max(0.0, footprint.reach - v * v)) / footprint.whiten_x;
}

// Columns in which alpha >= alpha_min somewhere in the given rows.
inline PixelRange columns_of(const Footprint& footprint, PixelRange rows, int width)
{
    const double low = rows.first + 0.5 - footprint.mean_y, high = rows.last + 0.5 - footprint.mean_y;
    const double right = extent_right(footprint, low, high, footprint.shear, footprint.widest_dy);
    const double left = extent_right(footprint, low, high, -footprint.shear, -footprint.widest_dy);
    return pixels_between(footprint.mean_x - left, footprint.mean_x + right, width);
}

// Calls visit(tile index) for each tile that the footprint touches, in rising order.
template <class Visit> void for_each_tile(const Footprint& footprint, const TileGrid& grid, Visit&& visit)
{
    const PixelRange rows = rows_of(footprint, grid.height);
    for (int top = rows.first / TILE_SIZE * TILE_SIZE; top <= rows.last; top += TILE_SIZE) {
        const PixelRange band{std::max(top, rows.first), std::min(top + TILE_SIZE - 1, rows.last)};
        const PixelRange columns = columns_of(footprint, band, grid.width);
        for (int left = columns.first / TILE_SIZE; left * TILE_SIZE <= columns.last; ++left)
            visit(size_t(top / TILE_SIZE) * grid.columns() + left);
    }
}

// Lists of all tiles. `tile_count` (Gaussians,) is how many tiles each touches; those with none are left out.
// Order: by depth, then by index.
TileLists list_tiles(
    const std::vector<Footprint>& footprints, const std::vector<uint32_t>& tile_count, const TileGrid& grid);
