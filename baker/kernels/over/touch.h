// Finds the tiles that a Gaussian touches.
#pragma once

#include "over/load.h"
#include "over/projection.h"
#include "over/records.h"

namespace INSTRUCTION_SET {

constexpr int ROWS_MAX = 8; // rows of tiles that are searched for eight Gaussians side by side

// The ellipses of eight Gaussians inside which alpha >= alpha_min, slightly enlarged to allow for rounding.
struct Ellipses {
    Wide mean_x, mean_y, shear, inverse_whiten_x, whiten_y, reach;
    Wide apex; // offset in y at which each ellipse extends furthest to the right

    template <class Real>
    Ellipses(const Footprint<Real>* footprints, const Drawn* const* drawn, double log2_alpha_min)
    {
        double x[8], y[8], k[8], wx[8], wy[8], o[8];
        for (int i = 0; i < 8; ++i) {
            const Footprint<Real>& f = footprints[drawn[i]->gaussian];
            x[i] = f.mean_x, y[i] = f.mean_y, k[i] = f.shear, wx[i] = f.whiten_x, wy[i] = f.whiten_y;
            o[i] = f.log2_opacity;
        }
        mean_x = Wide::load(x), mean_y = Wide::load(y), shear = Wide::load(k), whiten_y = Wide::load(wy);
        inverse_whiten_x = 1.0 / Wide::load(wx);
        reach = (Wide::load(o) - log2_alpha_min) * 1.001 + 1e-4;
        const Wide slope = shear * Wide::load(wx) / whiten_y;
        apex = slope / whiten_y * sqrt(reach / (1.0 + slope * slope));
    }

    // Extents to the right (sign 1) or left (-1) of the mean within [low, high], offsets in y from the mean.
    // The extent is concave in y: if its apex lies outside, the nearest end of the range extends furthest.
    Wide extent(Wide low, Wide high, double sign) const
    {
        const Wide dy = min(max(sign * apex, low), high), v = whiten_y * dy;
        return sign * shear * dy + sqrt(max(reach - v * v, Wide(0))) * inverse_whiten_x;
    }
};

// Calls visit(gaussian, first, last) for the range of tiles, last included, that a Gaussian touches in a row.
template <class Real, class Visit>
ALWAYS_INLINE void visit_row(
    const TileSearch<Real>& search, uint32_t gaussian, int row, double left, double right, Visit&& visit)
{
    if (!(right >= 0 && left <= search.width - 1))
        return;
    const size_t start = size_t(row) * search.columns, limit = search.last_tile - 1;
    const size_t first = start + (left > 0 ? size_t(left + 0.9999) / TILE_SIZE : 0);
    const size_t last = start + (right < search.width - 1 ? size_t(right) : search.width - 1) / TILE_SIZE;
    visit(gaussian, first > search.first_tile ? first : search.first_tile, last < limit ? last : limit);
}

// Left and right ends of ellipses in rows of tiles, px: [row][ellipse].
struct Spans {
    double left[ROWS_MAX][8], right[ROWS_MAX][8];
};

// Finds the spans of consecutive rows, starting with the row at `top` (px) of each ellipse.
inline void find_spans(const Ellipses& ellipses, const double* top, int rows, Spans& spans)
{
    for (int r = 0; r < rows; ++r) {
        const Wide low = Wide::load(top) + (r * TILE_SIZE + 0.5) - ellipses.mean_y;
        const Wide high = low + double(TILE_SIZE - 1);
        (ellipses.mean_x - ellipses.extent(low, high, -1) - 0.5).store(spans.left[r]);
        (ellipses.mean_x + ellipses.extent(low, high, 1) - 0.5).store(spans.right[r]);
    }
}

// Visits all tiles of the first of up to eight Gaussians, then those of the second and so on, so that each
// tile's list stays in depth order.
template <class Real, class Visit>
inline void visit_tiles(const TileSearch<Real>& search, const Drawn* const* drawn, int count, Visit&& visit)
{
    const int first_row = int(search.first_tile / search.columns);
    const int last_row = int((search.last_tile - 1) / search.columns);
    int row[8], end[8], rows = 0;
    for (int i = 0; i < 8; ++i) {
        row[i] = drawn[i]->first_row() > first_row ? drawn[i]->first_row() : first_row;
        end[i] = (drawn[i]->last_row() < last_row ? drawn[i]->last_row() : last_row) + 1;
        rows = end[i] - row[i] > rows ? end[i] - row[i] : rows;
    }
    if (rows > ROWS_MAX && count > 1) { // visit one at a time, with any number of rows
        for (int i = 0; i < count; ++i) {
            const Drawn* alone[8];
            for (const Drawn*& item : alone)
                item = drawn[i];
            visit_tiles(search, alone, 1, visit);
        }
        return;
    }
    const Ellipses ellipses(search.footprints, drawn, search.log2_alpha_min);
    for (int done = 0; done < rows; done += ROWS_MAX) {
        Spans spans;
        double top[8];
        for (int i = 0; i < 8; ++i)
            top[i] = (row[i] + done) * TILE_SIZE;
        find_spans(ellipses, top, rows - done < ROWS_MAX ? rows - done : ROWS_MAX, spans);
        for (int i = 0; i < count; ++i)
            for (int r = 0; r < ROWS_MAX && row[i] + done + r < end[i]; ++r)
                visit_row(search, drawn[i]->gaussian, row[i] + done + r, spans.left[r][i], spans.right[r][i],
                    visit);
    }
}

template <class Real, class Visit>
ALWAYS_INLINE void for_each_touched(const TileSearch<Real>& search, Visit&& visit)
{
    const int first_row = int(search.first_tile / search.columns),
              last_row = int((search.last_tile - 1) / search.columns);
    const Drawn* group[8];
    int count = 0;
    for (const Drawn* drawn = search.begin; drawn < search.end; ++drawn) {
        if (search.end - drawn > PREFETCH_AHEAD)
            prefetch(search.footprints[drawn[PREFETCH_AHEAD].gaussian]);
        if (drawn->last_row() < first_row || drawn->first_row() > last_row)
            continue;
        group[count++] = drawn;
        if (count == 8) {
            visit_tiles(search, group, 8, visit);
            count = 0;
        }
    }
    for (int i = count; i < 8 && count > 0; ++i)
        group[i] = group[0];
    if (count > 0)
        visit_tiles(search, group, count, visit);
}

template <class Real> inline void count_tiles(const TileSearch<Real>& search, uint32_t* counts)
{
    for_each_touched(search, [&](uint32_t, size_t first, size_t last) {
        for (size_t tile = first; tile <= last; ++tile)
            ++counts[tile - search.first_tile];
    });
}

template <class Real>
inline void list_tiles(const TileSearch<Real>& search, uint32_t* next, uint32_t* entries)
{
    for_each_touched(search, [&](uint32_t gaussian, size_t first, size_t last) {
        for (size_t tile = first; tile <= last; ++tile)
            entries[next[tile - search.first_tile]++] = gaussian;
    });
}

} // namespace INSTRUCTION_SET
