/* Cells, from those of a grid down, and which Gaussians reach each. */
#include "cell_tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ROOTS 8      /* cells along the longest edge of the box, before any is split */
#define SPLIT_MIN 24 /* bodies in a cell that is worth eight more */
#define FINEST 0.32  /* edge of a leaf over the mean length of its bodies, over the fourth root of edge over median */
#define COARSEST 0.5
#define FINENESS_COUNT 15000.0 /* it grows with the number of bodies in between */

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
    b->typical = b->count % 2 ? lengths[half] : (lengths[half - 1] + lengths[half]) / 2.0f;
    gsgi__release(b->callbacks, lengths);

    float high[3], widest = 0.0f;
    for (uint32_t i = 0; i < b->count; ++i) {
        const float* shape = level->shape.texels + (size_t)b->bodies[i].gaussian * GSGI_SHAPE_FLOATS;
        const float reach = fminf(b->bodies[i].length, 2.0f * b->typical);
        for (int k = 0; k < 3; ++k) {
            b->low[k] = i ? fminf(b->low[k], shape[k] - reach) : shape[k] - reach;
            high[k] = i ? fmaxf(high[k], shape[k] + reach) : shape[k] + reach;
        }
    }
    for (int k = 0; k < 3; ++k) widest = fmaxf(widest, high[k] - b->low[k]);
    b->edge = widest / (float)ROOTS;
    for (int k = 0; k < 3; ++k)
        b->size[k] = (int32_t)fminf(fmaxf(ceilf((high[k] - b->low[k]) / b->edge), 1.0f), (float)ROOTS);
    return true;
}

static bool grow(const gsgi__tree* b, uint32_t** array, uint32_t count, uint32_t room) {
    uint32_t* larger = gsgi__tree_take(b, room, sizeof **array);
    if (!larger) return false;
    if (count > 0) memcpy(larger, *array, count * sizeof **array);
    gsgi__release(b->callbacks, *array);
    *array = larger;
    return true;
}

static bool add_pair(const gsgi__tree* b, gsgi__depth* d, uint32_t body, uint32_t node, uint32_t parent) {
    if (d->pairs == d->room) {
        const uint32_t room = d->room ? 2 * d->room : 1024;
        if (d->room > GSGI_NOWHERE / 2 || !grow(b, &d->body, d->pairs, room) || !grow(b, &d->node, d->pairs, room) ||
            !grow(b, &d->parent, d->pairs, room))
            return false;
        d->room = room;
    }
    d->body[d->pairs] = body;
    d->node[d->pairs] = node;
    d->parent[d->pairs++] = parent;
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

/* The pairs of the grid's cells. */
static bool add_root_pairs(const gsgi__tree* b, gsgi__depth* d) {
    const float half = (float)(0.5 + GSGI_CELLS_SLACK) * b->edge;
    for (uint32_t i = 0; i < b->count; ++i) {
        int32_t from[3], to[3];
        cells_of(b, &b->bodies[i], from, to);
        for (int32_t x = from[0]; x <= to[0]; ++x)
            for (int32_t y = from[1]; y <= to[1]; ++y)
                for (int32_t z = from[2]; z <= to[2]; ++z) {
                    const uint32_t node = (uint32_t)((x * b->size[1] + y) * b->size[2] + z);
                    float offset[3];
                    for (int k = 0; k < 3; ++k) offset[k] = b->bodies[i].centre[k] - d->middle[node][k];
                    if (gsgi__body_meets(&b->bodies[i], offset, half) && !add_pair(b, d, i, node, 0)) return false;
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

/* Number the children of nodes that are large for the bodies in them. Returns the number of children, or GSGI_NOWHERE
 * without memory. */
static uint32_t judge(const gsgi__tree* b, gsgi__depth* d, float half, double fineness, bool last) {
    uint32_t* found = gsgi__tree_take(b, d->nodes, sizeof *found);
    double* wish = gsgi__tree_take(b, d->nodes, sizeof *wish);
    const double edge = (double)(2.0f * half), least = fineness * sqrt(sqrt(edge / (double)b->typical));
    uint32_t children = found && wish ? 0 : GSGI_NOWHERE;
    for (uint32_t p = 0; p < d->pairs && children == 0; ++p) {
        ++found[d->node[p]];
        wish[d->node[p]] += (double)(1.0f / b->bodies[d->body[p]].length);
    }
    for (uint32_t i = 0; i < d->nodes && children != GSGI_NOWHERE; ++i) {
        const bool large = edge * wish[i] > least * found[i];
        const bool split = !last && found[i] >= SPLIT_MIN && large && children <= GSGI_NOWHERE - 16;
        d->child[i] = split ? children : GSGI_NOWHERE;
        if (split) children += 8;
    }
    gsgi__release(b->callbacks, found);
    gsgi__release(b->callbacks, wish);
    return children;
}

/* The pairs of the depth below. */
static bool add_child_pairs(const gsgi__tree* b, const gsgi__depth* d, gsgi__depth* below, float half, float slack) {
    for (uint32_t p = 0; p < d->pairs; ++p) {
        const uint32_t node = d->node[p];
        if (d->child[node] == GSGI_NOWHERE) continue;
        const gsgi__body* a = &b->bodies[d->body[p]];
        for (uint32_t corner = 0; corner < 8; ++corner) {
            float offset[3];
            bool near = true; /* whether its box meets the cube, which is soon said */
            for (int k = 0; k < 3; ++k) {
                const float side = corner >> (2 - k) & 1 ? half : -half;
                offset[k] = a->centre[k] - d->middle[node][k] - side;
                near = near && !(fabsf(offset[k]) - (half + slack) > a->bound[k]);
            }
            if (near && gsgi__body_meets(a, offset, half + slack) &&
                !add_pair(b, below, d->body[p], d->child[node] + corner, p))
                return false;
        }
    }
    return true;
}

static bool make_depths(gsgi__tree* b) {
    const double fineness = fmin(fmax(b->count / FINENESS_COUNT, FINEST), COARSEST);
    const float slack = (float)GSGI_CELLS_SLACK * b->edge;
    float half = b->edge / 2.0f;
    if (!make_roots(b)) return false;
    for (;;) {
        gsgi__depth* d = &b->depths[b->used - 1];
        const uint32_t children = judge(b, d, half, fineness, b->used > GSGI_DEPTH_MAX);
        if (children == GSGI_NOWHERE) return false;
        if (children == 0) return true;
        gsgi__depth* below = &b->depths[b->used++];
        half /= 2.0f;
        below->nodes = children;
        if (!allocate_nodes(b, below)) return false;
        for (uint32_t i = 0; i < d->nodes; ++i)
            for (uint32_t corner = 0; corner < 8 && d->child[i] != GSGI_NOWHERE; ++corner)
                for (int k = 0; k < 3; ++k) {
                    const float side = corner >> (2 - k) & 1 ? half : -half;
                    below->middle[d->child[i] + corner][k] = d->middle[i][k] + side;
                }
        if (!add_child_pairs(b, d, below, half, slack)) return false;
    }
}

bool gsgi__tree_create(gsgi__tree* b, const gsgi__level* level, double radius) {
    if (!make_grid(b, level, (float)radius)) return false;
    for (uint32_t i = 0; i < b->count; ++i) {
        const float* shape = level->shape.texels + (size_t)b->bodies[i].gaussian * GSGI_SHAPE_FLOATS;
        gsgi__body_make(b->low, shape, radius, &b->bodies[i]);
    }
    return make_depths(b);
}

void gsgi__tree_destroy(gsgi__tree* b) {
    for (int l = 0; l < b->used; ++l) {
        const gsgi__depth* d = &b->depths[l];
        void* const arrays[] = {d->body, d->node, d->parent, d->middle, d->child, d->listed, d->above};
        for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i) gsgi__release(b->callbacks, arrays[i]);
    }
    gsgi__release(b->callbacks, b->bodies);
}
