/* Cells, from those of a grid down, and which Gaussians reach each. */
#include "cell_tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ROOTS 16     /* cells along the longest edge of the box at most, before any is split */
#define SPLIT_MIN 16 /* bodies in a cell that are worth eight more */

/* Most pairs at one depth: in all, and more for each body. */
#define PAIRS (1 << 20)
#define PAIRS_EACH 32

/* A body listed in a cell costs a read at each point in the octants that it reaches, and memory. Listed in the cell's
 * children instead, it is read less by SAVED - reached of SAVED_OF points. Memory is worth a sixteenth of a
 * read per entry and PRICED bodies, from CHEAPEST to DEAREST of them. */
#define SAVED 16
#define SAVED_OF 28
#define PRICED 240
#define CHEAPEST 7
#define DEAREST 28

void* gsgi__tree_take(const gsgi__tree* b, size_t count, size_t size) {
    if (size > 0 && count > SIZE_MAX / 2 / size) return NULL;
    void* memory = gsgi__allocate(b->callbacks, count * size + 1);
    if (memory) memset(memory, 0, count * size + 1);
    return memory;
}

static int ascending(const void* a, const void* b) {
    const float x = *(const float*)a, y = *(const float*)b;
    return (x > y) - (x < y);
}

/* Low corner, edge and number of cells of a grid around the centres, and most of what they reach. */
static bool make_grid(gsgi__tree* b, const gsgi__level* level, float radius) {
    float* lengths = gsgi__tree_take(b, b->count, sizeof *lengths);
    if (!lengths) return false;
    for (uint32_t i = 0; i < b->count; ++i) {
        const float* shape = level->shape.texels + (size_t)b->bodies[i].gaussian * GSGI_SHAPE_FLOATS;
        lengths[i] = b->bodies[i].length =
            radius * fmaxf(gsgi__body_scale(shape, 0), fmaxf(gsgi__body_scale(shape, 1), gsgi__body_scale(shape, 2)));
    }
    qsort(lengths, b->count, sizeof *lengths, ascending);
    const uint32_t half = b->count / 2;
    const float typical = b->count % 2 ? lengths[half] : (lengths[half - 1] + lengths[half]) / 2.0f;
    gsgi__release(b->callbacks, lengths);

    float high[3] = {0.0f}, widest = 0.0f;
    for (uint32_t i = 0; i < b->count; ++i) {
        const float* shape = level->shape.texels + (size_t)b->bodies[i].gaussian * GSGI_SHAPE_FLOATS;
        const float reach = fminf(b->bodies[i].length, 2.0f * typical);
        for (int k = 0; k < 3; ++k) {
            b->low[k] = i ? fminf(b->low[k], shape[k] - reach) : shape[k] - reach;
            high[k] = i ? fmaxf(high[k], shape[k] + reach) : shape[k] + reach;
        }
    }
    for (int k = 0; k < 3; ++k) widest = fmaxf(widest, high[k] - b->low[k]);
    uint32_t roots = 1;
    while (roots < ROOTS && roots * roots * roots < b->count) ++roots;
    b->edge = widest / (float)roots;
    for (int k = 0; k < 3; ++k)
        b->size[k] = (int32_t)fminf(fmaxf(ceilf((high[k] - b->low[k]) / b->edge), 1.0f), (float)roots);
    return true;
}

static bool add_pair(const gsgi__tree* b, gsgi__depth* d, uint32_t body, uint32_t node, uint32_t parent) {
    if (d->count == d->room) {
        const uint32_t room = d->room ? 2 * d->room : 1024;
        gsgi__pair* larger =
            d->room > GSGI_NOWHERE / 2 ? NULL : gsgi__allocate(b->callbacks, (size_t)room * sizeof *larger);
        if (!larger) return false;
        if (d->count > 0) memcpy(larger, d->pairs, d->count * sizeof *larger);
        gsgi__release(b->callbacks, d->pairs);
        d->pairs = larger;
        d->room = room;
    }
    d->pairs[d->count++] = (gsgi__pair){.body = body, .node = node, .parent = parent};
    return true;
}

static bool allocate_nodes(const gsgi__tree* b, gsgi__depth* d) {
    return (d->middle = gsgi__tree_take(b, d->nodes, sizeof *d->middle)) &&
           (d->child = gsgi__tree_take(b, d->nodes, 4));
}

static void cells_of(const gsgi__tree* b, const gsgi__body* a, int32_t from[3], int32_t to[3]) {
    const float slack = (float)GSGI_CELLS_SLACK * b->edge;
    for (int k = 0; k < 3; ++k) {
        const float reach = a->bound[k] + slack, last = (float)(b->size[k] - 1);
        from[k] = (int32_t)fminf(fmaxf(floorf((a->centre[k] - reach) / b->edge), 0.0f), last);
        to[k] = (int32_t)fminf(fmaxf(floorf((a->centre[k] + reach) / b->edge), 0.0f), last);
    }
}

static uint64_t most_pairs(const gsgi__tree* b) { return PAIRS + (uint64_t)PAIRS_EACH * b->count; }

/* Take fewer, larger cells if large bodies would fill them all. */
static void limit_roots(gsgi__tree* b) {
    while (b->size[0] > 1 || b->size[1] > 1 || b->size[2] > 1) {
        uint64_t pairs = 0;
        for (uint32_t i = 0; i < b->count; ++i) {
            int32_t from[3], to[3];
            cells_of(b, &b->bodies[i], from, to);
            pairs +=
                (uint64_t)(to[0] - from[0] + 1) * (uint64_t)(to[1] - from[1] + 1) * (uint64_t)(to[2] - from[2] + 1);
        }
        if (pairs <= most_pairs(b)) return;
        b->edge *= 2.0f;
        for (int k = 0; k < 3; ++k) b->size[k] = (b->size[k] + 1) / 2;
    }
}

/* The pairs of the grid's cells. */
static bool add_root_pairs(const gsgi__tree* b, gsgi__depth* d) {
    const float half = (float)(0.5 + GSGI_CELLS_SLACK) * b->edge;
    for (uint32_t i = 0; i < b->count; ++i) {
        const gsgi__body* a = &b->bodies[i];
        int32_t from[3], to[3];
        cells_of(b, a, from, to);
        const int32_t rows = to[1] - from[1] + 1, columns = to[2] - from[2] + 1;
        const int32_t cells = (to[0] - from[0] + 1) * rows * columns;
        for (int32_t first = 0; first < cells; first += 8) {
            const int32_t some = cells - first < 8 ? cells - first : 8;
            uint32_t node[8];
            float offset[3][8] = {{0.0f}};
            for (int32_t c = 0; c < some; ++c) {
                const int32_t x = from[0] + (first + c) / (rows * columns);
                const int32_t y = from[1] + (first + c) / columns % rows, z = from[2] + (first + c) % columns;
                node[c] = (uint32_t)((x * b->size[1] + y) * b->size[2] + z);
                for (int k = 0; k < 3; ++k) offset[k][c] = a->centre[k] - d->middle[node[c]][k];
            }
            const uint8_t met = gsgi__body_meets(a, offset, half);
            for (int32_t c = 0; c < some; ++c)
                if (met >> c & 1 && !add_pair(b, d, i, node[c], 0)) return false;
        }
    }
    return true;
}

static bool make_roots(gsgi__tree* b) {
    gsgi__depth* d = &b->depths[0];
    b->used = 1;
    d->nodes = (uint32_t)(b->size[0] * b->size[1] * b->size[2]);
    if (!allocate_nodes(b, d)) return false;
    for (uint32_t i = 0; i < d->nodes; ++i) {
        const uint32_t z = i % (uint32_t)b->size[2], y = i / (uint32_t)b->size[2] % (uint32_t)b->size[1];
        const uint32_t at[3] = {i / (uint32_t)(b->size[1] * b->size[2]), y, z};
        for (int k = 0; k < 3; ++k) d->middle[i][k] = ((float)at[k] + 0.5f) * b->edge;
    }
    return add_root_pairs(b, d);
}

/* Put the points that lie in the grid into its cells. */
static void place_readings(gsgi__tree* b) {
    size_t kept = 0;
    for (size_t i = 0; i < b->reading_count; ++i) {
        gsgi__reading r = b->readings[i];
        bool inside = true;
        r.node = 0;
        for (int k = 0; k < 3; ++k) {
            const float at = r.part[k] / b->edge;
            inside = inside && at >= 0.0f && at < (float)b->size[k];
            const int32_t cell = inside ? (int32_t)at : 0;
            r.part[k] = at - (float)cell;
            r.node = r.node * (uint32_t)b->size[k] + (uint32_t)cell;
        }
        if (inside) b->readings[kept++] = r;
    }
    b->reading_count = kept;
}

/* The octants of all points, and how many are in each octant of the nodes: 8 per node. */
static float* count_readings(gsgi__tree* b, uint32_t nodes) {
    float* crowds = gsgi__tree_take(b, nodes, 8 * sizeof *crowds);
    for (size_t i = 0; i < b->reading_count && crowds; ++i) {
        gsgi__reading* r = &b->readings[i];
        r->octant = 0;
        for (int k = 0; k < 3; ++k) {
            const float part = 2.0f * r->part[k], upper = part >= 1.0f ? 1.0f : 0.0f;
            r->part[k] = part - upper;
            r->octant = 2 * r->octant + (upper > 0.0f);
        }
        crowds[8 * r->node + r->octant] += 1.0f;
    }
    return crowds;
}

/* Move the points to the children of their nodes; drop those in leaves. */
static void descend_readings(gsgi__tree* b, const gsgi__depth* d) {
    size_t kept = 0;
    for (size_t i = 0; i < b->reading_count; ++i) {
        gsgi__reading r = b->readings[i];
        if (d->child[r.node] == GSGI_NOWHERE) continue;
        r.node = d->child[r.node] + r.octant;
        b->readings[kept++] = r;
    }
    b->reading_count = kept;
}

/* Which octants of its node a pair's body reaches, and whether it is worth listing in children. */
static void look_at(const gsgi__tree* b, const gsgi__depth* d, gsgi__pair* p, const float crowd[8], float half,
                    float wide) {
    const gsgi__body* a = &b->bodies[p->body];
    int reached = 8;
    bool empty = true;
    for (int o = 0; o < 8; ++o) empty = empty && crowd[o] == 0.0f;
    p->octants = 255;
    if (!empty) {
        float offset[3][8];
        for (int k = 0; k < 3; ++k) {
            const float from_middle = a->centre[k] - d->middle[p->node][k];
            for (int o = 0; o < 8; ++o) offset[k][o] = o >> (2 - k) & 1 ? from_middle - half : from_middle + half;
        }
        p->octants = gsgi__body_meets(a, offset, wide);
        reached = 0;
        for (int o = 0; o < 8; ++o) {
            p->crowd += (float)(p->octants >> o & 1) * crowd[o];
            reached += p->octants >> o & 1;
        }
    }
    p->pushed = p->crowd * (float)(SAVED - reached) > b->price * SAVED_OF * (float)(reached - 1);
}

/* Look at all pairs, and number the children of nodes with enough that are pushed. Returns the number of children, or
 * GSGI_NOWHERE without memory. */
static uint32_t judge(gsgi__tree* b, gsgi__depth* d, float half, float wide, bool last) {
    float* crowds = count_readings(b, d->nodes);
    uint32_t* pushed = gsgi__tree_take(b, d->nodes, sizeof *pushed);
    uint32_t children = crowds && pushed ? 0 : GSGI_NOWHERE;
    uint64_t below = 0;
    for (uint32_t i = 0; i < d->count && children == 0; ++i) {
        gsgi__pair* p = &d->pairs[i];
        look_at(b, d, p, crowds + 8 * (size_t)p->node, half, wide);
        pushed[p->node] += p->pushed;
        for (int o = 0; o < 8 && p->pushed; ++o) below += p->octants >> o & 1;
    }
    last = last || below > most_pairs(b);
    for (uint32_t i = 0; i < d->nodes && children != GSGI_NOWHERE; ++i) {
        const bool split = !last && pushed[i] >= SPLIT_MIN && children <= GSGI_NOWHERE - 16;
        d->child[i] = split ? children : GSGI_NOWHERE;
        if (split) children += 8;
    }
    for (uint32_t i = 0; i < d->count && children != GSGI_NOWHERE; ++i)
        d->pairs[i].pushed = d->pairs[i].pushed && d->child[d->pairs[i].node] != GSGI_NOWHERE;
    gsgi__release(b->callbacks, crowds);
    gsgi__release(b->callbacks, pushed);
    return children;
}

/* The pairs of the depth below. */
static bool add_child_pairs(const gsgi__tree* b, const gsgi__depth* d, gsgi__depth* below) {
    for (uint32_t i = 0; i < d->count; ++i) {
        const gsgi__pair* p = &d->pairs[i];
        for (uint32_t corner = 0; corner < 8 && p->pushed; ++corner)
            if (p->octants >> corner & 1 && !add_pair(b, below, p->body, d->child[p->node] + corner, i)) return false;
    }
    return true;
}

static bool make_depths(gsgi__tree* b) {
    const float slack = (float)GSGI_CELLS_SLACK * b->edge;
    float half = b->edge / 2.0f;
    if (!make_roots(b)) return false;
    place_readings(b);
    for (;;) {
        gsgi__depth* d = &b->depths[b->used - 1];
        half /= 2.0f;
        const uint32_t children = judge(b, d, half, half + slack, b->used > GSGI_DEPTH_MAX);
        if (children == GSGI_NOWHERE) return false;
        if (children == 0) return true;
        gsgi__depth* below = &b->depths[b->used++];
        below->nodes = children;
        if (!allocate_nodes(b, below)) return false;
        for (uint32_t i = 0; i < d->nodes; ++i)
            for (uint32_t corner = 0; corner < 8 && d->child[i] != GSGI_NOWHERE; ++corner)
                for (int k = 0; k < 3; ++k) {
                    const float side = corner >> (2 - k) & 1 ? half : -half;
                    below->middle[d->child[i] + corner][k] = d->middle[i][k] + side;
                }
        if (!add_child_pairs(b, d, below)) return false;
        descend_readings(b, d);
    }
}

bool gsgi__tree_create(gsgi__tree* b, const gsgi__level* level, double radius, uint32_t price) {
    uint32_t sixteenths = b->count / PRICED;
    sixteenths = sixteenths < CHEAPEST ? CHEAPEST : sixteenths > DEAREST ? DEAREST : sixteenths;
    b->price = (float)(price * sixteenths) / 16.0f;
    b->reading_count = (size_t)b->count * GSGI_BODY_POINTS;
    if (!make_grid(b, level, (float)radius)) return false;
    if (!(b->readings = gsgi__tree_take(b, b->reading_count, sizeof *b->readings))) return false;
    for (uint32_t i = 0; i < b->count; ++i) {
        const float* shape = level->shape.texels + (size_t)b->bodies[i].gaussian * GSGI_SHAPE_FLOATS;
        float points[GSGI_BODY_POINTS][3];
        gsgi__body_make(b->low, shape, radius, &b->bodies[i], points);
        for (int p = 0; p < GSGI_BODY_POINTS; ++p)
            memcpy(b->readings[(size_t)i * GSGI_BODY_POINTS + p].part, points[p], sizeof points[p]);
    }
    limit_roots(b);
    return make_depths(b);
}

void gsgi__tree_destroy(gsgi__tree* b) {
    for (int l = 0; l < b->used; ++l) {
        gsgi__release(b->callbacks, b->depths[l].pairs);
        gsgi__release(b->callbacks, b->depths[l].middle);
        gsgi__release(b->callbacks, b->depths[l].child);
    }
    gsgi__release(b->callbacks, b->readings);
    gsgi__release(b->callbacks, b->bodies);
}
