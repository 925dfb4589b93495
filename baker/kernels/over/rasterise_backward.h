// The gradient of blending the Gaussians of one tile.
#pragma once

#include "over/rasterise.h"

namespace INSTRUCTION_SET {

// State of the backward pass per pixel.
template <class Real> struct BackwardPlanes {
    Plane<Real> by_red = {}, by_green = {}, by_blue = {}, error = {};
    Plane<Real> transmittance = {}; // 0 outside the image
    Plane<Real> behind = {};        // dot(by_radiance, light from behind the current Gaussian)
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

// Moments of one Gaussian in one tile, summed separately in each lane.
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

// Adds the moments of one Gaussian in one block. Returns false if the block let no light through to it.
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
    const auto free = (s.unclamped <= L(tile.alpha_max)) & s.drawn; // where alpha is not clamped
    sums.add_weight(weight, by_red, by_green, by_blue, planes.error.load(block));
    sums.add_p(select(free, fma(zero - odds, behind, added), zero), s.u, s.v);
    return bits_of(lit) != 0;
}

// Visits the Gaussians front to back again, so that only the result of the forward pass is needed per pixel:
// the transmittance has exactly the same bits as there, and the light from behind is the pixel's total less
// the light blended so far.
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
