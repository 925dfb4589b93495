// Blends the Gaussians of one tile front to back, and the gradient of that.
//
// Kerbl et al. 2023. A tile is cut into blocks of 4 x 4 pixels, one per lane; a Gaussian visits only the
// blocks that it reaches and that still let light through. Real is float, or double for checking the
// gradients.
#pragma once

#include "elementary.h"
#include "records.h"

namespace INSTRUCTION_SET {

constexpr int BLOCK = 4;                         // px
constexpr int BLOCKS_ACROSS = TILE_SIZE / BLOCK; // of a tile
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

// Calls visit(block, lane, pixel) for the tile's pixels that lie in the image; `pixel` counts through the
// image.
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

// One Gaussian in one tile: u and v of its pixels.
template <class Real> struct Brush {
    Lanes16<Real> u, v;                        // of the first block
    alignas(64) Real block_u[16], block_v[16]; // what each block adds to that
    Lanes16<Real> log2_opacity;
    uint32_t blocks; // bit per block that it may reach

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

        // The nearest that u and v come to 0 in each block; a little is added against rounding.
        const L half = Real(0.5 * (BLOCK - 1)), zero = 0;
        const L centre_u = first_u + of_block_u + half * (along_x + along_y);
        const L centre_v = first_v + of_block_v + half * v_along_y;
        const L near_u = max(absolute(centre_u) - half * (along_x + absolute(along_y)), zero);
        const L near_v = max(absolute(centre_v) - half * v_along_y, zero);
        const L reach = Real((f.log2_opacity - tile.log2_alpha_min) * Real(1.001) + Real(1e-4));
        blocks = bits_of(fma(near_u, near_u, near_v * near_v) <= reach);
    }
};

// What a Gaussian covers of the pixels of a block.
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
    Plane<Real> red = {}, green = {}, blue = {},
                transmittance = {}; // 0 outside the image: nothing is added there
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

// What backward keeps per pixel.
template <class Real> struct BackwardPlanes {
    Plane<Real> by_red = {}, by_green = {}, by_blue = {}, error = {};
    Plane<Real> transmittance = {}; // 0 outside the image
    Plane<Real> behind = {};        // by_radiance . (what the pixel shows behind the current Gaussian)
    uint32_t live = 0;              // blocks inside the image

    BackwardPlanes(const Tile<Real>& tile, const Pixels<const Real>& pixels, const PixelGradients<Real>& by)
    {
        for_each_pixel(tile, [&](int block, int lane, size_t pixel) {
            const Real* const g = by.by_radiance + 3 * pixel;
            const Real* const shown = pixels.radiance + 3 * pixel;
            by_red.value[block][lane] = g[0], by_green.value[block][lane] = g[1],
            by_blue.value[block][lane] = g[2];
            error.value[block][lane] = by.error ? by.error[pixel] : Real(0);
            transmittance.value[block][lane] = 1;
            const Real background =
                by.by_transmittance ? by.by_transmittance[pixel] * pixels.transmittance[pixel] : 0;
            behind.value[block][lane] = g[0] * shown[0] + g[1] * shown[1] + g[2] * shown[2] + background;
            live |= 1u << block;
        });
    }
};

// Sums over the pixels that one Gaussian covers of a tile, lane by lane.
template <class Real> struct MomentSums {
    using L = Lanes16<Real>;
    L red = 0, green = 0, blue = 0, p = 0, pu = 0, pv = 0, puu = 0, puv = 0, pvv = 0, weight = 0, error = 0;

    ALWAYS_INLINE void add_weight(L w, L by_red, L by_green, L by_blue, L e)
    {
        red = fma(w, by_red, red);
        green = fma(w, by_green, green);
        blue = fma(w, by_blue, blue);
        weight = weight + w;
        error = fma(w, e, error);
    }

    ALWAYS_INLINE void add_p(L by_log_alpha, L u, L v)
    {
        const L by_u = by_log_alpha * u, by_v = by_log_alpha * v;
        p = p + by_log_alpha;
        pu = pu + by_u;
        pv = pv + by_v;
        puu = fma(by_u, u, puu);
        puv = fma(by_u, v, puv);
        pvv = fma(by_v, v, pvv);
    }

    ALWAYS_INLINE void add_to(Real* moments) const
    {
        const L all[16] = {red, green, blue, p, pu, pv, puu, puv, pvv, weight, error, 0, 0, 0, 0, 0};
        Real total[16];
        sums(all).store(total);
        for (int m = 0; m < MOMENTS; ++m)
            moments[m] += total[m];
    }
};

// Adds what one block shows of a Gaussian; false where the block lets no more light through.
template <class Real>
ALWAYS_INLINE bool blend_block_backward(const Tile<Real>& tile, const Footprint<Real>& footprint,
    const Brush<Real>& brush, int block, BackwardPlanes<Real>& planes, MomentSums<Real>& sums)
{
    using L = Lanes16<Real>;
    const L t = planes.transmittance.load(block), zero = 0;
    const auto lit = L(Real(TRANSMITTANCE_MIN)) <= t;
    const Sample<Real> s = sample(brush, block, lit, tile);
    const L weight = t * s.alpha;
    const L by_red = planes.by_red.load(block), by_green = planes.by_green.load(block),
            by_blue = planes.by_blue.load(block);
    const L shown = fma(L(footprint.colour[0]), by_red,
        fma(L(footprint.colour[1]), by_green, L(footprint.colour[2]) * by_blue));
    const L added = weight * shown, behind = planes.behind.load(block) - added;
    planes.transmittance.store(block, t - weight);
    planes.behind.store(block, behind);

    const L odds = s.alpha / (L(1) - s.alpha);
    const auto free = (s.unclamped <= L(tile.alpha_max)) & s.drawn; // where alpha follows the exponent
    sums.add_weight(weight, by_red, by_green, by_blue, planes.error.load(block));
    sums.add_p(select(free, fma(zero - odds, behind, added), zero), s.u, s.v);
    return bits_of(lit) != 0;
}

// Front to back again, so that nothing per pixel but the result of forward is needed: the transmittance has
// the very bits that it had there, and what lies behind is the pixel's total less what has passed.
template <class Real>
inline void blend_tile_backward(const Tile<Real>& tile, const Pixels<const Real>& pixels,
    const PixelGradients<Real>& by, const MomentOutput<Real>& output)
{
    BackwardPlanes<Real> planes(tile, pixels, by);
    uint32_t live = planes.live;
    for (size_t k = 0; k < tile.entry_count; ++k) {
        if (k + PREFETCH_AHEAD < tile.entry_count)
            prefetch(tile.footprints[tile.entries[k + PREFETCH_AHEAD]]);
        const Footprint<Real>& footprint = tile.footprints[tile.entries[k]];
        const Brush<Real> brush(footprint, tile);
        uint32_t left = brush.blocks & live;
        Real* const moments = output.by_entry ? output.by_entry + k * MOMENTS
                                              : output.by_gaussian + size_t(tile.entries[k]) * MOMENTS;
        if (output.by_entry)
            std::memset(moments, 0, MOMENTS * sizeof(Real));
        if (!left)
            continue;
        MomentSums<Real> sums;
        for (; left; left &= left - 1) {
            const int block = __builtin_ctz(left);
            const bool lit = blend_block_backward(tile, footprint, brush, block, planes, sums);
            live &= ~(uint32_t(!lit) << block);
        }
        sums.add_to(moments);
    }
}

} // namespace INSTRUCTION_SET
