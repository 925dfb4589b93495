/* Lists of the Gaussians of a level by cells of space, for look-ups at single points. */
#ifndef GSGI_CELL_LISTS_H
#define GSGI_CELL_LISTS_H

#include "internal.h"

/* A grid of `size` cubic cells of `edge` m begins at `low`. Its cells are the first nodes, z fastest; the next one is
 * for all points outside of the grid. Node i has the Gaussians entry[first[i]] up to entry[first[i + 1] - 1], of which
 * each reaches those octants of the node of which `octants` has the bit, 4 x + 2 y + z with 0 or 1 for the lower or
 * upper half. If child[i] is not 0, it is split into eight, child[i] + the octant; children follow the grid in eights.
 */
typedef struct gsgi__cell_lists {
    float low[3], edge;
    int32_t size[3];
    uint32_t nodes, entries;
    uint32_t *first, *child, *entry;
    uint8_t* octants;
} gsgi__cell_lists;

#define GSGI_COARSE_PRICE 16 /* of memory at the coarse level, which is seldom read; that of the fine level is 1 */

/* Returns false if there is no memory. `radius`: standard deviations at which Gaussians end. */
bool gsgi__cell_lists_create(gsgi__cell_lists* lists, const gsgi_callbacks* callbacks, const gsgi__level* level,
                             double radius, uint32_t price);
void gsgi__cell_lists_destroy(gsgi__cell_lists* lists, const gsgi_callbacks* callbacks);

#endif
