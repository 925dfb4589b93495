// Blends the Gaussians of one tile front to back.
//
// Kerbl et al. 2023. A tile is divided into blocks of 4 x 4 pixels, one per lane. A Gaussian visits only the
// blocks that it reaches and that still let light through. Real is float, or double to check the gradients.
#pragma once

#include "over/records.h"
#include "simd/elementary.h"

namespace INSTRUCTION_SET {

constexpr int BLOCK = 4;                         // px
constexpr int BLOCKS_ACROSS = TILE_SIZE / BLOCK; // in a tile
constexpr int BLOCKS = BLOCKS_ACROSS * BLOCKS_ACROSS;
static_assert(
    BLOCK * BLOCK == 16 && BLOCKS == 16, "both the pixels of a block and the blocks of a tile are lanes");

template <class Real> using Lanes16 = Lanes<Real, 16>;

// Column and row of lane i in a square of 4 x 4.
template <class Real> struct Square {
    Real column[16], row[16];
};
template <class Real>
inline constexpr Square<Real> SQUARE = {
    {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3}, {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3}};

// Calls visit(block, lane, pixel) for the tile's pixels in the image. `pixel` is the index in the image.
template <class Real, class Visit> ALWAYS_INLINE void for_each_pixel(const Tile<Real>& tile, Visit&& visit)
{
    const int width = tile.width - tile.left < TILE_SIZE ? tile.width - tile.left : TILE_SIZE;
    const int height = tile.height - tile.top < TILE_SIZE ? tile.height - tile.top : TILE_SIZE;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            visit(y / BLOCK * BLOCKS_ACROSS + x / BLOCK, y % BLOCK * BLOCK + x % BLOCK,
                size_t(tile.top + y) * tile.width + tile.left + x);
}

// One number per pixel of the tile, block by block.
template <class Real> struct Plane {
    alignas(64) Real value[BLOCKS][16];

    ALWAYS_INLINE Lanes16<Real> load(int block) const { return Lanes16<Real>::load(value[block]); }
    ALWAYS_INLINE void store(int block, Lanes16<Real> lanes) { lanes.store(value[block]); }
};

// One Gaussian in one tile: u and v (see Footprint) at the tile's pixels.
template <class Real> struct Brush {
    Lanes16<Real> u, v;                        // at the first block
    alignas(64) Real block_u[16], block_v[16]; // offset of each block from the first
    Lanes16<Real> log2_opacity;
    uint32_t blocks; // one bit per block that the Gaussian may reach

    ALWAYS_INLINE Brush(const Footprint<Real>& f, const Tile<Real>& tile)
    {
        using L = Lanes16<Real>;
        const double dx = tile.left + 0.5 - f.mean_x, dy = tile.top + 0.5 - f.mean_y;
        const L column = L::load(SQUARE<Real>.column), row = L::load(SQUARE<Real>.row);
        const L along_x = f.whiten_x, along_y = -f.whiten_x * f.shear, v_along_y = f.whiten_y;
        const L from_row = along_y * row, v_from_row = v_along_y * row;
        const L from_column = along_x * column;
        u = L(Real(f.whiten_x * (dx - f.shear * dy))) + (from_column + from_row);
        v = L(Real(f.whiten_y * dy)) + v_from_row;
        const L first_u = L(Real(f.whiten_x * (dx - f.shear * dy))), first_v = L(Real(f.whiten_y * dy));
        const L of_block_u = L(BLOCK) * (from_column + from_row), of_block_v = L(BLOCK) * v_from_row;
        of_block_u.store(block_u), of_block_v.store(block_v);
        log2_opacity = f.log2_opacity;

        // The smallest |u| and |v| in each block. `reach` is slightly enlarged to allow for rounding.
        const L half = Real(0.5 * (BLOCK - 1)), zero = 0;
        const L centre_u = first_u + of_block_u + half * (along_x + along_y);
        const L centre_v = first_v + of_block_v + half * v_along_y;
        const L near_u = max(absolute(centre_u) - half * (along_x + absolute(along_y)), zero);
        const L near_v = max(absolute(centre_v) - half * v_along_y, zero);
        const L reach = Real((f.log2_opacity - tile.log2_alpha_min) * Real(1.001) + Real(1e-4));
        blocks = bits_of(fma(near_u, near_u, near_v * near_v) <= reach);
    }
};

// One Gaussian at the pixels of one block.
template <class Real> struct Sample {
    Lanes16<Real> u, v;
    Mask<Real, 16> drawn;
    Lanes16<Real> unclamped;
    Lanes16<Real> alpha; // 0 where not drawn
};

template <class Real>
ALWAYS_INLINE Sample<Real> sample(
    const Brush<Real>& brush, int block, Mask<Real, 16> lit, const Tile<Real>& tile)
{
    using L = Lanes16<Real>;
    const L u = brush.u + L(brush.block_u[block]), v = brush.v + L(brush.block_v[block]), zero = 0;
    const L exponent = fma(zero - u, u, fma(zero - v, v, brush.log2_opacity));
    const auto drawn = (L(tile.log2_alpha_min) <= exponent) & lit;
    const L unclamped = exp2(exponent);
    return {u, v, drawn, unclamped, select(drawn, min(unclamped, L(tile.alpha_max)), zero)};
}

template <class Real> inline size_t blend_tile(const Tile<Real>& tile, const Pixels<Real>& pixels)
{
    using L = Lanes16<Real>;
    Plane<Real> red = {}, green = {}, blue = {};
    Plane<Real> transmittance = {}; // 0 outside the image, so nothing is added there
    uint32_t live = 0;
    for_each_pixel(tile, [&](int block, int lane, size_t) {
        transmittance.value[block][lane] = 1;
        live |= 1u << block;
    });

    size_t pairs = 0;
    for (size_t k = 0; k < tile.entry_count && live; ++k) {
        if (k + PREFETCH_AHEAD < tile.entry_count)
            prefetch(tile.footprints[tile.entries[k + PREFETCH_AHEAD]]);
        const Footprint<Real>& footprint = tile.footprints[tile.entries[k]];
        const Brush<Real> brush(footprint, tile);
        for (uint32_t left = brush.blocks & live; left; left &= left - 1) {
            const int block = __builtin_ctz(left);
            const L t = transmittance.load(block);
            const auto lit = L(Real(TRANSMITTANCE_MIN)) <= t;
            live &= ~(uint32_t(bits_of(lit) == 0) << block);
            const Sample<Real> s = sample(brush, block, lit, tile);
            const L weight = t * s.alpha;
            red.store(block, fma(weight, L(footprint.colour[0]), red.load(block)));
            green.store(block, fma(weight, L(footprint.colour[1]), green.load(block)));
            blue.store(block, fma(weight, L(footprint.colour[2]), blue.load(block)));
            transmittance.store(block, t - weight);
            pairs += __builtin_popcount(bits_of(s.drawn));
        }
    }

    for_each_pixel(tile, [&](int block, int lane, size_t pixel) {
        pixels.radiance[3 * pixel + 0] = red.value[block][lane];
        pixels.radiance[3 * pixel + 1] = green.value[block][lane];
        pixels.radiance[3 * pixel + 2] = blue.value[block][lane];
        pixels.transmittance[pixel] = transmittance.value[block][lane];
    });
    return pairs;
}

} // namespace INSTRUCTION_SET
