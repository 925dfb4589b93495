/* Which Gaussians reach each cell of space: an octree of lists. All arithmetic is that of runtime/cell_lists.py. */
#include "cell_lists.h"
#include "lib/constants.glsl"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ROOTS 8      /* cells along the longest edge of the box, before any is split */
#define DEPTH_MAX 20 /* splits of a root; floats within it have 24 bits */
#define SPLIT_MIN 6  /* sheets in a cell that is worth eight more */
#define SLACK 1e-5   /* of a root's edge and of an ellipsoid's radius; covers the rounding of floats */
#define FINEST 0.4   /* edge of a leaf over the mean in-plane radius of the Gaussians in it, */
#define COARSEST 0.85
#define FINEST_COUNT 2600.0 /* which grows with the number of Gaussians from this on */
#define SHEET 0.7           /* standard deviations around the centre */
#define NOWHERE UINT32_MAX

/* An ellipsoid; lengths are relative to the low corner of the grid, m. The shortest axis comes first. */
typedef struct body {
    uint32_t gaussian;
    float centre[3], axes[3][3], deviation[3];
    float whiten[3][3]; /* the axes, times the shortest deviation over theirs */
    float metric[3][3]; /* transpose(whiten) whiten */
    float bound[3];     /* half the bounding box */
    float reach;        /* the shortest semi-axis */
} body;

/* Nodes of one depth, and pairs of a node and a body that reaches it. */
typedef struct depth {
    uint32_t pairs, room, nodes;    /* room: pairs for which there are arrays */
    uint32_t *body, *node, *parent; /* per pair; parent: the pair of the depth above */
    float (*middle)[3];             /* per node */
    uint32_t* child;                /* per node: the first of the eight of the depth below; NOWHERE: a leaf */
    uint8_t* crossed;               /* per node: whether sheets cross it */
    uint8_t *listed, *above;        /* per pair: whether it is listed here; whether it is here or above */
} depth;

typedef struct builder {
    const gsgi_callbacks* callbacks;
    body* bodies;
    uint32_t count;
    float low[3], edge;
    int32_t size[3];
    depth depths[DEPTH_MAX + 1];
    int used; /* depths */
} builder;

static void* take(const builder* b, size_t count, size_t size) {
    if (size > 0 && count > SIZE_MAX / 2 / size) return NULL;
    void* memory = gsgi__allocate(b->callbacks, count * size + 1);
    if (memory) memset(memory, 0, count * size + 1);
    return memory;
}

static float dot3(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static float clamped(float x, float half) { return x < -half ? -half : x > half ? half : x; }

/* ---- Bodies and grid ---- */

static float scale_of(const float* shape, int axis) {
    return fminf(fmaxf(shape[8 + axis], (float)SCALE_MIN), (float)SCALE_MAX);
}

static int ascending(const void* a, const void* b) {
    const float x = *(const float*)a, y = *(const float*)b;
    return (x > y) - (x < y);
}

/* Low corner, edge and number of cells of a grid around the centres, and most of what they reach. */
static bool make_grid(builder* b, const gsgi__level* level, float radius) {
    float* bounds = take(b, b->count, sizeof *bounds);
    if (!bounds) return false;
    float near_low[3], near_high[3], far_low[3], far_high[3], high[3], widest = 0.0f;
    for (uint32_t i = 0; i < b->count; ++i) {
        const float* shape = level->shape.texels + (size_t)b->bodies[i].gaussian * GSGI_SHAPE_FLOATS;
        const float bound = radius * fmaxf(scale_of(shape, 0), fmaxf(scale_of(shape, 1), scale_of(shape, 2)));
        for (int k = 0; k < 3; ++k) {
            near_low[k] = i ? fminf(near_low[k], shape[k]) : shape[k];
            near_high[k] = i ? fmaxf(near_high[k], shape[k]) : shape[k];
            far_low[k] = i ? fminf(far_low[k], shape[k] - bound) : shape[k] - bound;
            far_high[k] = i ? fmaxf(far_high[k], shape[k] + bound) : shape[k] + bound;
        }
        bounds[i] = bound;
    }
    qsort(bounds, b->count, sizeof *bounds, ascending);
    const uint32_t half = b->count / 2;
    const float margin = 2.0f * (b->count % 2 ? bounds[half] : (bounds[half - 1] + bounds[half]) / 2.0f);
    gsgi__release(b->callbacks, bounds);
    for (int k = 0; k < 3; ++k) {
        b->low[k] = fmaxf(far_low[k], near_low[k] - margin);
        high[k] = fminf(far_high[k], near_high[k] + margin);
        widest = fmaxf(widest, high[k] - b->low[k]);
    }
    b->edge = widest / (float)ROOTS;
    for (int k = 0; k < 3; ++k)
        b->size[k] = (int32_t)fminf(fmaxf(ceilf((high[k] - b->low[k]) / b->edge), 1.0f), (float)ROOTS);
    return true;
}

static void make_body(const builder* b, const float* shape, double radius, body* to) {
    const float reach_of_one = (float)(radius * (1.0 + SLACK));
    float axes[3][3], reach[3];
    int order[3] = {0, 1, 2};
    for (int i = 1; i < 3; ++i) /* insertion sort: stable */
        for (int j = i; j > 0 && scale_of(shape, order[j]) < scale_of(shape, order[j - 1]); --j) {
            const int other = order[j];
            order[j] = order[j - 1];
            order[j - 1] = other;
        }
    gsgi__axes(shape + 4, axes);
    for (int i = 0; i < 3; ++i) {
        to->deviation[i] = scale_of(shape, order[i]);
        memcpy(to->axes[i], axes[order[i]], sizeof to->axes[i]);
        reach[i] = reach_of_one * to->deviation[i];
        for (int j = 0; j < 3; ++j) to->whiten[i][j] = to->axes[i][j] * (to->deviation[0] / to->deviation[i]);
    }
    for (int j = 0; j < 3; ++j) {
        float squares = 0.0f;
        for (int i = 0; i < 3; ++i) squares += to->axes[i][j] * to->axes[i][j] * (reach[i] * reach[i]);
        to->bound[j] = sqrtf(squares);
        to->centre[j] = shape[j] - b->low[j];
        for (int k = 0; k < 3; ++k)
            to->metric[j][k] = to->whiten[0][j] * to->whiten[0][k] + to->whiten[1][j] * to->whiten[1][k] +
                               to->whiten[2][j] * to->whiten[2][k];
    }
    to->reach = reach[0];
}

/* ---- Tests ---- */

/* Whether a body meets a cube; `offset` is from the cube's middle to the body's centre. They are apart if a plane parts
 * them. The best plane is that across the gradient, at the cube's point nearest to the centre in standard deviations,
 * which two rounds of descent along the axes find nearly always (Hildreth 1957). */
static bool meet(const body* a, const float offset[3], float half) {
    float point[3], away[3], gradient[3], white[3], across[3];
    if (fabsf(offset[0]) <= half && fabsf(offset[1]) <= half && fabsf(offset[2]) <= half) return true;
    for (int k = 0; k < 3; ++k) {
        point[k] = clamped(offset[k], half);
        away[k] = point[k] - offset[k];
    }
    for (int k = 0; k < 3; ++k) gradient[k] = dot3(a->metric[k], away);
    for (int n = 0; n < 6; ++n) {
        const int k = n % 3;
        const float moved = clamped(point[k] - gradient[k] / fmaxf(a->metric[k][k], FLT_MIN), half);
        const float step = moved - point[k];
        point[k] = moved;
        for (int j = 0; j < 3; ++j) gradient[j] = gradient[j] + a->metric[j][k] * step;
    }
    /* From here on as exact as floats are: long ellipsoids have lost digits above. */
    for (int k = 0; k < 3; ++k) away[k] = point[k] - offset[k];
    for (int i = 0; i < 3; ++i) white[i] = dot3(a->whiten[i], away);
    for (int j = 0; j < 3; ++j)
        across[j] = a->whiten[0][j] * white[0] + a->whiten[1][j] * white[1] + a->whiten[2][j] * white[2];
    const float gap = -dot3(across, offset) - half * (fabsf(across[0]) + fabsf(across[1]) + fabsf(across[2]));
    return !(gap > a->reach * sqrtf(dot3(white, white)));
}

/* What the sheets of the bodies in a node count for, when it is to be judged. */
typedef struct sheets {
    uint32_t through, crossing;
    double wish;
} sheets;

static void count_sheet(const body* a, const float offset[3], float half, sheets* node) {
    float far = 0.0f;
    for (int k = 0; k < 3; ++k) {
        const float along = fabsf(dot3(offset, a->axes[k]));
        const float width = half * (fabsf(a->axes[k][0]) + fabsf(a->axes[k][1]) + fabsf(a->axes[k][2]));
        if (k == 0) {
            if (!(along <= width)) return;
            continue;
        }
        const float beyond = fmaxf(along - width / 2.0f, 0.0f) / a->deviation[k];
        far = far + beyond * beyond;
    }
    ++node->through;
    if (!(far <= (float)(SHEET * SHEET))) return;
    /* Where points lie on a sheet, as many more Gaussians than reach a point are listed as the cell's edge is longer
     * than their mean in-plane radius. */
    const float mean = a->reach / a->deviation[0] * 2.0f / (1.0f / a->deviation[1] + 1.0f / a->deviation[2]);
    ++node->crossing;
    node->wish += (double)(1.0f / mean);
}

/* ---- Depths ---- */

static bool grow(const builder* b, uint32_t** array, uint32_t count, uint32_t room) {
    uint32_t* larger = take(b, room, sizeof **array);
    if (!larger) return false;
    if (count > 0) memcpy(larger, *array, count * sizeof **array);
    gsgi__release(b->callbacks, *array);
    *array = larger;
    return true;
}

static bool add_pair(const builder* b, depth* d, uint32_t body, uint32_t node, uint32_t parent) {
    if (d->pairs == d->room) {
        const uint32_t room = d->room ? 2 * d->room : 1024;
        if (d->room > NOWHERE / 2 || !grow(b, &d->body, d->pairs, room) || !grow(b, &d->node, d->pairs, room) ||
            !grow(b, &d->parent, d->pairs, room))
            return false;
        d->room = room;
    }
    d->body[d->pairs] = body;
    d->node[d->pairs] = node;
    d->parent[d->pairs++] = parent;
    return true;
}

static bool allocate_nodes(const builder* b, depth* d) {
    return (d->middle = take(b, d->nodes, sizeof *d->middle)) && (d->child = take(b, d->nodes, 4)) &&
           (d->crossed = take(b, d->nodes, 1));
}

static void cells_of(const builder* b, const body* a, int32_t from[3], int32_t to[3]) {
    const float slack = (float)SLACK * b->edge;
    for (int k = 0; k < 3; ++k) {
        const float reach = a->bound[k] + slack, last = (float)(b->size[k] - 1);
        from[k] = (int32_t)fminf(fmaxf(floorf((a->centre[k] - reach) / b->edge), 0.0f), last);
        to[k] = (int32_t)fminf(fmaxf(floorf((a->centre[k] + reach) / b->edge), 0.0f), last);
    }
}

/* The pairs of the grid's cells. */
static bool add_root_pairs(const builder* b, depth* d) {
    const float half = (float)(0.5 + SLACK) * b->edge;
    for (uint32_t i = 0; i < b->count; ++i) {
        int32_t from[3], to[3];
        cells_of(b, &b->bodies[i], from, to);
        for (int32_t x = from[0]; x <= to[0]; ++x)
            for (int32_t y = from[1]; y <= to[1]; ++y)
                for (int32_t z = from[2]; z <= to[2]; ++z) {
                    const uint32_t node = (uint32_t)((x * b->size[1] + y) * b->size[2] + z);
                    float offset[3];
                    for (int k = 0; k < 3; ++k) offset[k] = b->bodies[i].centre[k] - d->middle[node][k];
                    if (meet(&b->bodies[i], offset, half) && !add_pair(b, d, i, node, 0)) return false;
                }
    }
    return true;
}

static bool make_roots(builder* b) {
    depth* d = &b->depths[0];
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

/* Mark which nodes sheets cross, and number the children of those that are large for the Gaussians of these sheets.
 * Returns the number of children, or NOWHERE without memory. */
static uint32_t judge(const builder* b, depth* d, float half, double fineness, bool last) {
    sheets* found = take(b, d->nodes, sizeof *found);
    uint32_t children = 0;
    if (!found) return NOWHERE;
    for (uint32_t p = 0; p < d->pairs; ++p) {
        const body* a = &b->bodies[d->body[p]];
        float offset[3];
        for (int k = 0; k < 3; ++k) offset[k] = a->centre[k] - d->middle[d->node[p]][k];
        count_sheet(a, offset, half, &found[d->node[p]]);
    }
    for (uint32_t i = 0; i < d->nodes; ++i) {
        d->crossed[i] = found[i].crossing > 0;
        const bool large = (double)(2.0f * half) * found[i].wish > fineness * found[i].crossing;
        const bool split = !last && found[i].through >= SPLIT_MIN && large && children <= NOWHERE - 16;
        d->child[i] = split ? children : NOWHERE;
        if (split) children += 8;
    }
    gsgi__release(b->callbacks, found);
    return children;
}

/* The pairs of the depth below. */
static bool add_child_pairs(const builder* b, const depth* d, depth* below, float half, float slack) {
    for (uint32_t p = 0; p < d->pairs; ++p) {
        const uint32_t node = d->node[p];
        if (d->child[node] == NOWHERE) continue;
        const body* a = &b->bodies[d->body[p]];
        for (uint32_t corner = 0; corner < 8; ++corner) {
            float offset[3];
            for (int k = 0; k < 3; ++k) {
                const float side = corner >> (2 - k) & 1 ? half : -half;
                offset[k] = a->centre[k] - d->middle[node][k] - side;
            }
            if (meet(a, offset, half + slack) && !add_pair(b, below, d->body[p], d->child[node] + corner, p))
                return false;
        }
    }
    return true;
}

static bool make_depths(builder* b) {
    const double fineness = fmin(fmax(FINEST * sqrt(b->count / FINEST_COUNT), FINEST), COARSEST);
    const float slack = (float)SLACK * b->edge;
    float half = b->edge / 2.0f;
    if (!make_roots(b)) return false;
    for (;;) {
        depth* d = &b->depths[b->used - 1];
        const uint32_t children = judge(b, d, half, fineness, b->used > DEPTH_MAX);
        if (children == NOWHERE) return false;
        if (children == 0) return true;
        depth* below = &b->depths[b->used++];
        half /= 2.0f;
        below->nodes = children;
        if (!allocate_nodes(b, below)) return false;
        for (uint32_t i = 0; i < d->nodes; ++i)
            for (uint32_t corner = 0; corner < 8 && d->child[i] != NOWHERE; ++corner)
                for (int k = 0; k < 3; ++k) {
                    const float side = corner >> (2 - k) & 1 ? half : -half;
                    below->middle[d->child[i] + corner][k] = d->middle[i][k] + side;
                }
        if (!add_child_pairs(b, d, below, half, slack)) return false;
    }
}

/* ---- Lists ---- */

/* Mark where pairs are listed: in leaves, and where all children that sheets cross would list them. */
static bool mark_listed(builder* b) {
    for (int l = 0; l < b->used; ++l) {
        depth* d = &b->depths[l];
        if (!(d->listed = take(b, d->pairs, 1)) || !(d->above = take(b, d->pairs, 1))) return false;
    }
    memset(b->depths[b->used - 1].listed, 1, b->depths[b->used - 1].pairs);
    for (int l = b->used - 2; l >= 0; --l) {
        depth* d = &b->depths[l];
        const depth* below = &b->depths[l + 1];
        uint8_t* found = take(b, d->pairs, 1);
        if (!found) return false;
        for (uint32_t q = 0; q < below->pairs; ++q)
            if (below->listed[q] && below->crossed[below->node[q]]) ++found[below->parent[q]];
        for (uint32_t p = 0; p < d->pairs; ++p) {
            const uint32_t child = d->child[d->node[p]];
            unsigned needed = 0;
            for (uint32_t corner = 0; corner < 8 && child != NOWHERE; ++corner)
                needed += below->crossed[child + corner];
            d->listed[p] = child == NOWHERE || (found[p] > 0 && found[p] == needed);
        }
        gsgi__release(b->callbacks, found);
    }
    /* What is listed in a node is listed nowhere below. */
    for (int l = 0; l < b->used; ++l) {
        depth* d = &b->depths[l];
        for (uint32_t p = 0; p < d->pairs; ++p) {
            const bool above = l > 0 && b->depths[l - 1].above[d->parent[p]];
            d->above[p] = above || d->listed[p];
            d->listed[p] = d->listed[p] && !above;
        }
    }
    return true;
}

static bool sticks_out(const builder* b, const body* a) {
    for (int k = 0; k < 3; ++k)
        if (!(a->centre[k] - a->bound[k] > 0.0f &&
              (double)(a->centre[k] + a->bound[k]) < (double)b->size[k] * (double)b->edge))
            return true;
    return false;
}

/* `first`, `child` and `entry` of all nodes; that of all points outside of the grid comes after the grid's cells. */
static bool assemble(const builder* b, gsgi__cell_lists* lists) {
    const uint32_t roots = b->depths[0].nodes;
    uint64_t nodes = 1, entries = 0;
    for (int l = 0; l < b->used; ++l) {
        nodes += b->depths[l].nodes;
        for (uint32_t p = 0; p < b->depths[l].pairs; ++p) entries += b->depths[l].listed[p];
    }
    for (uint32_t i = 0; i < b->count; ++i) entries += sticks_out(b, &b->bodies[i]);
    if (nodes >= NOWHERE || entries >= NOWHERE) return false;
    lists->nodes = (uint32_t)nodes;
    lists->entries = (uint32_t)entries;
    lists->first = take(b, lists->nodes + 1, 4);
    lists->child = take(b, lists->nodes, 4);
    lists->entry = take(b, lists->entries, 4);
    if (!lists->first || !lists->child || !lists->entry) return false;

    /* Count, then place. The number of a node of depth l: `begin` of the depth and its own. */
    for (int pass = 0; pass < 2; ++pass) {
        uint32_t begin = 0;
        for (int l = 0; l < b->used; ++l) {
            const depth* d = &b->depths[l];
            const uint32_t below = begin + d->nodes + (l == 0);
            for (uint32_t i = 0; i < d->nodes; ++i)
                lists->child[begin + i] = d->child[i] == NOWHERE ? 0 : below + d->child[i];
            for (uint32_t p = 0; p < d->pairs; ++p) {
                if (!d->listed[p]) continue;
                uint32_t* at = &lists->first[begin + d->node[p]];
                if (pass) lists->entry[*at] = b->bodies[d->body[p]].gaussian;
                ++*at;
            }
            if (l == 0) {
                for (uint32_t i = 0; i < b->count; ++i) {
                    if (!sticks_out(b, &b->bodies[i])) continue;
                    if (pass) lists->entry[lists->first[roots]] = b->bodies[i].gaussian;
                    ++lists->first[roots];
                }
            }
            begin = below;
        }
        /* Counts become the places where lists begin. Filling a list has moved its place to where the next begins. */
        uint32_t sum = 0;
        for (uint32_t i = 0; i <= lists->nodes; ++i) {
            const uint32_t found = lists->first[i];
            lists->first[i] = sum;
            sum = pass ? found : sum + found;
        }
    }
    return true;
}

static void release(builder* b) {
    for (int l = 0; l < b->used; ++l) {
        const depth* d = &b->depths[l];
        void* const arrays[] = {d->body, d->node, d->parent, d->middle, d->child, d->crossed, d->listed, d->above};
        for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i) gsgi__release(b->callbacks, arrays[i]);
    }
    gsgi__release(b->callbacks, b->bodies);
}

bool gsgi__cell_lists_create(gsgi__cell_lists* lists, const gsgi_callbacks* callbacks, const gsgi__level* level,
                             double radius) {
    builder b = {.callbacks = callbacks, .edge = 1.0f};
    bool built = (b.bodies = take(&b, level->count, sizeof *b.bodies)) != NULL;
    memset(lists, 0, sizeof *lists);
    for (uint32_t i = 0; built && i < level->count; ++i)
        if (level->shape.texels[(size_t)i * GSGI_SHAPE_FLOATS + 3] > 0.0f) b.bodies[b.count++].gaussian = i;
    if (built && b.count > 0) {
        built = make_grid(&b, level, (float)radius);
        for (uint32_t i = 0; built && i < b.count; ++i)
            make_body(&b, level->shape.texels + (size_t)b.bodies[i].gaussian * GSGI_SHAPE_FLOATS, radius, &b.bodies[i]);
        built = built && make_depths(&b) && mark_listed(&b);
    }
    lists->edge = b.edge;
    memcpy(lists->low, b.low, sizeof b.low);
    memcpy(lists->size, b.size, sizeof b.size);
    built = built && assemble(&b, lists);
    release(&b);
    if (!built) gsgi__cell_lists_destroy(lists, callbacks);
    return built;
}

void gsgi__cell_lists_destroy(gsgi__cell_lists* lists, const gsgi_callbacks* callbacks) {
    gsgi__release(callbacks, lists->first);
    gsgi__release(callbacks, lists->child);
    gsgi__release(callbacks, lists->entry);
    memset(lists, 0, sizeof *lists);
}
