#include "rasterise.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "exp.h"

// The loops below are written for the compiler's vectoriser: fixed trip counts, no branches per pixel, one
// accumulator per column. Each instruction set computes the same bits, as nothing is reassociated or fused.
#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__)
#define VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define VECTOR_CLONES
#endif

namespace {

template <class Value> using Columns = Value[TILE_SIZE];
template <class Value> using Pixels = Columns<Value>[TILE_SIZE];

// The pixels of a tile. Backward, red, green and blue hold the gradient by radiance.
template <class Real> struct TilePixels {
    Pixels<Real> red = {}, green = {}, blue = {};
    Pixels<Real> transmittance = {}; // 0 outside the image: nothing is added there
    Pixels<Real> behind = {};        // backward only, see blend_row_backward
    Pixels<int32_t> last;            // position in the list of the last Gaussian that counts

    TilePixels() { std::fill_n(&last[0][0], TILE_SIZE * TILE_SIZE, -1); }
};

// What is the same for all pixels of one Gaussian.
template <class Real> struct Brush {
    Real red, green, blue;
    Real opacity, alpha_min, alpha_max;

    Brush(const Footprint& f, const Blend& blend)
        : red(Real(f.colour[0]))
        , green(Real(f.colour[1]))
        , blue(Real(f.colour[2]))
        , opacity(Real(f.opacity))
        , alpha_min(Real(blend.alpha_min))
        , alpha_max(Real(blend.alpha_max))
    {
    }
};

// A footprint along one row of the tile.
template <class Real> struct Row {
    Real centre; // px from the tile's left edge
    Real whiten;
    Real v, vv;
};

// What a Gaussian covers of one pixel.
template <class Real> struct Sample {
    Real u;
    Real unclamped;
    Real alpha; // 0 where skipped
};

} // namespace

static const int DEAD_TILE_INTERVAL = 8; // entries between looks whether any pixel still lets light through

static ALWAYS_INLINE PixelRange rows_in_tile(const Footprint& footprint, const Tile& tile)
{
    const PixelRange rows = rows_of(footprint, tile.grid.height);
    return {std::max(rows.first - tile.top, 0), std::min(rows.last - tile.top, TILE_SIZE - 1)};
}

// False where alpha < alpha_min on the whole row.
template <class Real>
static ALWAYS_INLINE bool cross_row(const Footprint& footprint, const Tile& tile, int y, Row<Real>& row)
{
    const double dy = tile.top + y + 0.5 - footprint.mean_y;
    const double centre = footprint.mean_x + footprint.shear * dy - tile.left;
    const double v = footprint.whiten_y * dy;
    const double nearest_u =
        footprint.whiten_x * std::max(0.0, std::abs(centre - 0.5 * TILE_SIZE) - 0.5 * (TILE_SIZE - 1));
    row = {Real(centre), Real(footprint.whiten_x), Real(v), Real(v * v)};
    return nearest_u * nearest_u + v * v <= footprint.reach;
}

template <class Real>
static ALWAYS_INLINE Sample<Real> sample(const Row<Real>& row, int x, const Brush<Real>& brush, bool reached)
{
    const Real u = (Real(x) + Real(0.5) - row.centre) * row.whiten;
    const Real unclamped = brush.opacity * exp_negative(-(u * u + row.vv));
    const Real alpha = unclamped < brush.alpha_max ? unclamped : brush.alpha_max;
    return {u, unclamped, bool(reached & (alpha >= brush.alpha_min)) ? alpha : Real(0)};
}

// Calls visit(x, y, pixel) for the tile's pixels that lie in the image; `pixel` counts through the image.
template <class Visit> static ALWAYS_INLINE void for_each_pixel(const Tile& tile, Visit&& visit)
{
    const int width = std::min(TILE_SIZE, tile.grid.width - tile.left);
    const int height = std::min(TILE_SIZE, tile.grid.height - tile.top);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            visit(x, y, size_t(tile.top + y) * tile.grid.width + tile.left + x);
}

template <class Real> static ALWAYS_INLINE bool any_light(const Pixels<Real>& transmittance)
{
    Columns<Real> brightest = {};
    for (int y = 0; y < TILE_SIZE; ++y)
        for (int x = 0; x < TILE_SIZE; ++x)
            brightest[x] = std::max(brightest[x], transmittance[y][x]);
    return *std::max_element(brightest, brightest + TILE_SIZE) >= Real(TRANSMITTANCE_MIN);
}

// Adds entry k of the tile's list to row y.
template <class Real>
static ALWAYS_INLINE void blend_row(
    TilePixels<Real>& pixels, int y, const Row<Real>& row, const Brush<Real>& brush, int k)
{
    for (int x = 0; x < TILE_SIZE; ++x) {
        const Real t = pixels.transmittance[y][x];
        const Real alpha = sample(row, x, brush, t >= Real(TRANSMITTANCE_MIN)).alpha;
        const Real weight = t * alpha;
        pixels.red[y][x] += weight * brush.red;
        pixels.green[y][x] += weight * brush.green;
        pixels.blue[y][x] += weight * brush.blue;
        pixels.transmittance[y][x] = t * (1 - alpha);
        pixels.last[y][x] = alpha > 0 ? k : pixels.last[y][x];
    }
}

template <class Real>
static ALWAYS_INLINE void blend(const Tile& tile, Real* radiance, const Coverage<Real>& coverage)
{
    TilePixels<Real> pixels;
    for_each_pixel(tile, [&](int x, int y, size_t) { pixels.transmittance[y][x] = 1; });

    for (int k = 0; k < tile.entry_count; ++k) {
        if (k % DEAD_TILE_INTERVAL == 0 && !any_light(pixels.transmittance))
            break;
        const Footprint& footprint = tile.footprints[tile.entries[k].gaussian];
        const Brush<Real> brush(footprint, tile.blend);
        const PixelRange rows = rows_in_tile(footprint, tile);
        for (int y = rows.first; y <= rows.last; ++y)
            if (Row<Real> row; cross_row(footprint, tile, y, row))
                blend_row(pixels, y, row, brush, k);
    }

    for_each_pixel(tile, [&](int x, int y, size_t pixel) {
        radiance[3 * pixel + 0] = pixels.red[y][x];
        radiance[3 * pixel + 1] = pixels.green[y][x];
        radiance[3 * pixel + 2] = pixels.blue[y][x];
        coverage.transmittance[pixel] = pixels.transmittance[y][x];
        coverage.last[pixel] = pixels.last[y][x];
    });
}

// Takes entry k off row y, back to front. `behind` is by_radiance . (what a pixel shows behind the current
// Gaussian), per unit of transmittance; behind everything lies by_transmittance. Undoing T *= 1 - alpha
// loses far less than subtracting radiance would.
template <class Real>
static ALWAYS_INLINE void blend_row_backward(TilePixels<Real>& pixels, int y, const Row<Real>& row,
    const Brush<Real>& brush, int k, Columns<Real>* sum)
{
    for (int x = 0; x < TILE_SIZE; ++x) {
        const Real by_red = pixels.red[y][x], by_green = pixels.green[y][x], by_blue = pixels.blue[y][x];
        const Sample<Real> s = sample(row, x, brush, pixels.last[y][x] >= k);
        const Real t = pixels.transmittance[y][x] / (1 - s.alpha);
        const Real weight = t * s.alpha;
        const Real shown = brush.red * by_red + brush.green * by_green + brush.blue * by_blue;
        const Real contrast = shown - pixels.behind[y][x];
        pixels.transmittance[y][x] = t;
        pixels.behind[y][x] += s.alpha * contrast;

        const Real p = s.unclamped <= brush.alpha_max ? weight * contrast : Real(0);
        sum[RED][x] += weight * by_red;
        sum[GREEN][x] += weight * by_green;
        sum[BLUE][x] += weight * by_blue;
        sum[P][x] += p;
        sum[P_U][x] += p * s.u;
        sum[P_V][x] += p * row.v;
        sum[P_UU][x] += p * s.u * s.u;
        sum[P_UV][x] += p * s.u * row.v;
        sum[P_VV][x] += p * row.vv;
    }
}

template <class Real>
static ALWAYS_INLINE void blend_backward(const Tile& tile, const Coverage<const Real>& coverage,
    const Real* by_radiance, const Real* by_transmittance, Real* moments)
{
    TilePixels<Real> pixels;
    int last_of_all = -1;
    for_each_pixel(tile, [&](int x, int y, size_t pixel) {
        pixels.red[y][x] = by_radiance[3 * pixel + 0];
        pixels.green[y][x] = by_radiance[3 * pixel + 1];
        pixels.blue[y][x] = by_radiance[3 * pixel + 2];
        pixels.transmittance[y][x] = coverage.transmittance[pixel];
        pixels.behind[y][x] = by_transmittance[pixel];
        pixels.last[y][x] = coverage.last[pixel];
        last_of_all = std::max(last_of_all, coverage.last[pixel]);
    });

    for (int k = tile.entry_count - 1; k >= 0; --k) {
        Columns<Real> sum[MOMENTS] = {};
        const Footprint& footprint = tile.footprints[tile.entries[k].gaussian];
        const Brush<Real> brush(footprint, tile.blend);
        const PixelRange rows = k <= last_of_all ? rows_in_tile(footprint, tile) : PixelRange{0, -1};
        for (int y = rows.first; y <= rows.last; ++y)
            if (Row<Real> row; cross_row(footprint, tile, y, row))
                blend_row_backward(pixels, y, row, brush, k, sum);

        Real* const out = moments + size_t(tile.entries[k].slot) * MOMENTS;
        for (int m = 0; m < MOMENTS; ++m)
            out[m] = std::accumulate(sum[m], sum[m] + TILE_SIZE, Real(0));
    }
}

VECTOR_CLONES void blend_tile(const Tile& tile, float* radiance, const Coverage<float>& coverage)
{
    blend(tile, radiance, coverage);
}

VECTOR_CLONES void blend_tile(const Tile& tile, double* radiance, const Coverage<double>& coverage)
{
    blend(tile, radiance, coverage);
}

VECTOR_CLONES void blend_tile_backward(const Tile& tile, const Coverage<const float>& coverage,
    const float* by_radiance, const float* by_transmittance, float* moments)
{
    blend_backward(tile, coverage, by_radiance, by_transmittance, moments);
}

VECTOR_CLONES void blend_tile_backward(const Tile& tile, const Coverage<const double>& coverage,
    const double* by_radiance, const double* by_transmittance, double* moments)
{
    blend_backward(tile, coverage, by_radiance, by_transmittance, moments);
}
