/* Boxes of sectors: which of them overlap or touch, and how the light of each fades at its borders. */
#include "world.h"

#include <math.h>
#include <string.h>

#define FAR_AWAY 16.0 /* diagonals, as in bake.c */

/* How long what two boxes share is along an axis, m, if they are `wide` larger on each side; negative: apart. */
static double shared(const gsgi__sector* a, const gsgi__sector* b, int axis, double wide) {
    const double low = a->low[axis] > b->low[axis] ? a->low[axis] : b->low[axis];
    const double high = a->high[axis] < b->high[axis] ? a->high[axis] : b->high[axis];
    return (high + wide) - (low - wide);
}

static bool share_volume(const gsgi__sector* a, const gsgi__sector* b, double wide) {
    return shared(a, b, 0, wide) > 0.0 && shared(a, b, 1, wide) > 0.0 && shared(a, b, 2, wide) > 0.0;
}

bool gsgi__boxes_overlap(const gsgi_world* world, uint32_t* first, uint32_t* second) {
    for (*second = 0; *second < world->sector_count; ++*second)
        for (*first = 0; *first < *second; ++*first)
            if (share_volume(&world->sectors[*first], &world->sectors[*second], 0.0)) return true;
    return false;
}

bool gsgi__are_neighbours(const gsgi__sector* a, const gsgi__sector* b) {
    int touching = 0;
    for (int k = 0; k < 3; ++k) {
        const double length = shared(a, b, k, 0.0);
        if (!(length >= 0.0)) return false;
        touching += length == 0.0;
    }
    return touching == 1;
}

/* Whether light of a sector that ends at the faces of its neighbours alone would reach into another one's box. */
static bool reaches(const gsgi__sector* sector, const gsgi__sector* other) {
    for (int k = 0; k < 3; ++k) {
        if (!sector->low_open[k] && !(sector->low[k] < other->high[k])) return false;
        if (!sector->high_open[k] && !(sector->high[k] > other->low[k])) return false;
    }
    return true;
}

/* Ends the light of two sectors that are no neighbours in the middle of the widest gap between them, or, if that is
 * narrower than a border, beyond each side on which they are apart, where each has its whole light in its own box. */
static void part(gsgi__sector* a, gsgi__sector* b, double margin) {
    double gap[3], widest = -INFINITY;
    for (int k = 0; k < 3; ++k) {
        gap[k] = -shared(a, b, k, 0.0);
        widest = fmax(widest, gap[k]);
    }
    for (int k = 0; k < 3; ++k) {
        if (widest < 2.0 * margin ? gap[k] < 0.0 : gap[k] != widest) continue;
        gsgi__sector* const lower = b->low[k] >= a->high[k] ? a : b;
        gsgi__sector* const upper = lower == a ? b : a;
        const double beyond = fmax(gap[k] / 2.0, margin);
        lower->fade_high[k] = fmin(lower->fade_high[k], lower->high[k] + beyond);
        upper->fade_low[k] = fmax(upper->fade_low[k], upper->low[k] - beyond);
    }
}

void gsgi__divide(gsgi_world* world, uint32_t* taken) {
    for (uint32_t i = 0; i < world->sector_count; ++i) {
        gsgi__sector* sector = &world->sectors[i];
        memset(taken, 0, world->sector_count * sizeof *taken);
        for (int k = 0; k < 3; ++k) {
            sector->fade_low[k] = -GSGI_FACE_FAR;
            sector->fade_high[k] = GSGI_FACE_FAR;
            sector->low_open[k] = sector->high_open[k] = true;
        }
        for (uint32_t j = 0; j < world->sector_count; ++j) {
            const gsgi__sector* other = &world->sectors[j];
            if (j < i && share_volume(sector, other, world->margin)) taken[other->class] = 1;
            if (j == i || !gsgi__are_neighbours(sector, other)) continue;
            for (int k = 0; k < 3; ++k) {
                if (other->high[k] == sector->low[k]) {
                    sector->fade_low[k] = sector->low[k];
                    sector->low_open[k] = false;
                }
                if (other->low[k] == sector->high[k]) {
                    sector->fade_high[k] = sector->high[k];
                    sector->high_open[k] = false;
                }
            }
        }
        for (sector->class = 0; taken[sector->class]; ++sector->class) {
        }
    }
    for (uint32_t i = 0; i < world->sector_count; ++i)
        for (uint32_t j = 0; j < world->sector_count; ++j)
            if (i != j && reaches(&world->sectors[i], &world->sectors[j]))
                part(&world->sectors[i], &world->sectors[j], world->margin);
}

void gsgi__world_origin(const gsgi_world* world, double origin[3]) {
    double middle[3], from_origin = 0.0, diagonal = 0.0;
    for (int k = 0; k < 3; ++k) {
        double low = world->sectors[0].low[k], high = world->sectors[0].high[k];
        for (uint32_t i = 1; i < world->sector_count; ++i) {
            low = fmin(low, world->sectors[i].low[k]);
            high = fmax(high, world->sectors[i].high[k]);
        }
        middle[k] = (low + high) / 2;
        from_origin += middle[k] * middle[k];
        diagonal += (high - low) * (high - low);
    }
    const bool far = sqrt(from_origin) > FAR_AWAY * sqrt(diagonal);
    for (int k = 0; k < 3; ++k) origin[k] = far ? (float)middle[k] : 0.0;
}

float gsgi__window(const gsgi__sector* sector, double margin, const float point[3]) {
    double product = 1.0;
    for (int k = 0; k < 3; ++k) {
        const double to_low = (double)point[k] - sector->fade_low[k], to_high = sector->fade_high[k] - (double)point[k];
        const double inside = (to_low < to_high ? to_low : to_high) / (2.0 * margin) + 0.5;
        if (!(inside > 0.0)) return 0.0f; /* NaN too */
        if (inside < 1.0) product *= inside;
    }
    return (float)product;
}
