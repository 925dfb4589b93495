// Blends the Gaussians of one tile front to back, and the gradient of that.
//
// Kerbl et al. 2023. Real is float, or double for checking the gradients.
#pragma once

#include <cstdint>
#include <type_traits>

#include "projection.h"
#include "tiles.h"

// What one entry adds to the gradient of its Gaussian: sums over the pixels of a tile.
// With p = dloss / dln(alpha) and (u, v) the whitened offset from the mean:
enum Moment { RED, GREEN, BLUE, P, P_U, P_V, P_UU, P_UV, P_VV, MOMENTS };

// How far the light of each pixel of an image got: (height, width), rows packed.
template <class Value> struct Coverage {
    Value* transmittance;
    std::conditional_t<std::is_const_v<Value>, const int32_t, int32_t>*
        last; // position in the tile's list of the last Gaussian that counts, or -1
};

struct Tile {
    const Footprint* footprints;
    const Entry* entries;
    int entry_count;
    int left, top; // px, of the tile's first pixel
    TileGrid grid;
    Blend blend;
};

// Writes the tile's pixels of `radiance` (height, width, 3) and of `coverage`.
void blend_tile(const Tile& tile, float* radiance, const Coverage<float>& coverage);
void blend_tile(const Tile& tile, double* radiance, const Coverage<double>& coverage);

// Writes moments[slot * MOMENTS + ...] for each entry of the tile, from the gradient of the loss by radiance
// and by transmittance. `coverage` is what blend_tile wrote.
void blend_tile_backward(const Tile& tile, const Coverage<const float>& coverage, const float* by_radiance,
    const float* by_transmittance, float* moments);
void blend_tile_backward(const Tile& tile, const Coverage<const double>& coverage, const double* by_radiance,
    const double* by_transmittance, double* moments);
