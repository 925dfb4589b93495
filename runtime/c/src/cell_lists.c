/* Which Gaussians reach each cell of space: an octree of lists. All arithmetic is that of runtime/cell_lists.py. */
#include "cell_lists.h"

#include "cell_tree.h"

#include <string.h>

#define HOISTED 0.75 /* of the children with lists: what more of them would list is listed in the parent instead */

/* Mark where pairs are listed: in leaves, and where most children would list them. */
static bool mark_listed(gsgi__tree* b) {
    for (int l = 0; l < b->used; ++l) {
        gsgi__depth* d = &b->depths[l];
        if (!(d->listed = gsgi__tree_take(b, d->pairs, 1)) || !(d->above = gsgi__tree_take(b, d->pairs, 1)))
            return false;
    }
    memset(b->depths[b->used - 1].listed, 1, b->depths[b->used - 1].pairs);
    for (int l = b->used - 2; l >= 0; --l) {
        gsgi__depth* d = &b->depths[l];
        const gsgi__depth* below = &b->depths[l + 1];
        uint8_t *found = gsgi__tree_take(b, d->pairs, 1), *inhabited = gsgi__tree_take(b, below->nodes, 1);
        for (uint32_t q = 0; q < below->pairs && found && inhabited; ++q) {
            found[below->parent[q]] += below->listed[q];
            inhabited[below->node[q]] = 1;
        }
        for (uint32_t p = 0; p < d->pairs && found && inhabited; ++p) {
            const uint32_t child = d->child[d->node[p]];
            unsigned children = 0;
            for (uint32_t corner = 0; corner < 8 && child != GSGI_NOWHERE; ++corner)
                children += inhabited[child + corner];
            d->listed[p] = child == GSGI_NOWHERE || found[p] > HOISTED * children;
        }
        gsgi__release(b->callbacks, found);
        gsgi__release(b->callbacks, inhabited);
        if (!found || !inhabited) return false;
    }
    /* What is listed in a node is listed nowhere below. */
    for (int l = 0; l < b->used; ++l) {
        gsgi__depth* d = &b->depths[l];
        for (uint32_t p = 0; p < d->pairs; ++p) {
            const bool above = l > 0 && b->depths[l - 1].above[d->parent[p]];
            d->above[p] = above || d->listed[p];
            d->listed[p] = d->listed[p] && !above;
        }
    }
    return true;
}

static bool sticks_out(const gsgi__tree* b, const gsgi__body* a) {
    for (int k = 0; k < 3; ++k)
        if (!(a->centre[k] - a->bound[k] > 0.0f &&
              (double)(a->centre[k] + a->bound[k]) < (double)b->size[k] * (double)b->edge))
            return true;
    return false;
}

/* `first`, `child` and `entry` of all nodes; that of all points outside of the grid comes after the grid's cells. */
static bool assemble(const gsgi__tree* b, gsgi__cell_lists* lists) {
    const uint32_t roots = b->depths[0].nodes;
    uint64_t nodes = 1, entries = 0;
    for (int l = 0; l < b->used; ++l) {
        nodes += b->depths[l].nodes;
        for (uint32_t p = 0; p < b->depths[l].pairs; ++p) entries += b->depths[l].listed[p];
    }
    for (uint32_t i = 0; i < b->count; ++i) entries += sticks_out(b, &b->bodies[i]);
    if (nodes >= GSGI_NOWHERE || entries >= GSGI_NOWHERE) return false;
    lists->nodes = (uint32_t)nodes;
    lists->entries = (uint32_t)entries;
    lists->first = gsgi__tree_take(b, lists->nodes + 1, 4);
    lists->child = gsgi__tree_take(b, lists->nodes, 4);
    lists->entry = gsgi__tree_take(b, lists->entries, 4);
    if (!lists->first || !lists->child || !lists->entry) return false;

    /* Count, then place. The number of a node of depth l: `begin` of the depth and its own. */
    for (int pass = 0; pass < 2; ++pass) {
        uint32_t begin = 0;
        for (int l = 0; l < b->used; ++l) {
            const gsgi__depth* d = &b->depths[l];
            const uint32_t below = begin + d->nodes + (l == 0);
            for (uint32_t i = 0; i < d->nodes; ++i)
                lists->child[begin + i] = d->child[i] == GSGI_NOWHERE ? 0 : below + d->child[i];
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

bool gsgi__cell_lists_create(gsgi__cell_lists* lists, const gsgi_callbacks* callbacks, const gsgi__level* level,
                             double radius) {
    gsgi__tree b = {.callbacks = callbacks, .edge = 1.0f};
    bool built = (b.bodies = gsgi__tree_take(&b, level->count, sizeof *b.bodies)) != NULL;
    memset(lists, 0, sizeof *lists);
    for (uint32_t i = 0; built && i < level->count; ++i)
        if (level->shape.texels[(size_t)i * GSGI_SHAPE_FLOATS + 3] > 0.0f) b.bodies[b.count++].gaussian = i;
    if (built && b.count > 0) built = gsgi__tree_create(&b, level, radius) && mark_listed(&b);
    lists->edge = b.edge;
    memcpy(lists->low, b.low, sizeof b.low);
    memcpy(lists->size, b.size, sizeof b.size);
    built = built && assemble(&b, lists);
    gsgi__tree_destroy(&b);
    if (!built) gsgi__cell_lists_destroy(lists, callbacks);
    return built;
}

void gsgi__cell_lists_destroy(gsgi__cell_lists* lists, const gsgi_callbacks* callbacks) {
    gsgi__release(callbacks, lists->first);
    gsgi__release(callbacks, lists->child);
    gsgi__release(callbacks, lists->entry);
    memset(lists, 0, sizeof *lists);
}
