/* Which Gaussians reach each cell of space: an octree of lists. All arithmetic is that of runtime/cell_lists.py. */
#include "cell_lists.h"

#include "cell_tree.h"

#include <string.h>

/* Mark where pairs are listed: in leaves, and where their children would cost more. */
static bool mark_listed(gsgi__tree* b) {
    double* below = NULL; /* what it costs, per pair, to list it in the children */
    for (int l = b->used - 1; l >= 0; --l) {
        const gsgi__depth* d = &b->depths[l];
        double* above = l > 0 ? gsgi__tree_take(b, b->depths[l - 1].count, sizeof *above) : NULL;
        if (l > 0 && !above) {
            gsgi__release(b->callbacks, below);
            return false;
        }
        for (uint32_t i = 0; i < d->count; ++i) {
            gsgi__pair* p = &d->pairs[i];
            const double here = (double)p->crowd + (double)b->price, children = below ? below[i] : 0.0;
            p->listed = !p->pushed || here <= children;
            if (l > 0) above[p->parent] += p->listed ? here : children;
        }
        gsgi__release(b->callbacks, below);
        below = above;
    }
    /* What is listed in a node is listed nowhere below. */
    for (int l = 0; l < b->used; ++l) {
        for (uint32_t i = 0; i < b->depths[l].count; ++i) {
            gsgi__pair* p = &b->depths[l].pairs[i];
            const bool above = l > 0 && b->depths[l - 1].pairs[p->parent].above;
            p->above = above || p->listed;
            p->listed = p->listed && !above;
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

/* `first`, `child`, `entry` and `octants` of all nodes; that of all points outside of the grid comes after the grid's
 * cells. */
static bool assemble(const gsgi__tree* b, gsgi__cell_lists* lists) {
    const uint32_t roots = b->depths[0].nodes;
    uint64_t nodes = 1, entries = 0;
    for (int l = 0; l < b->used; ++l) {
        nodes += b->depths[l].nodes;
        for (uint32_t i = 0; i < b->depths[l].count; ++i) entries += b->depths[l].pairs[i].listed;
    }
    for (uint32_t i = 0; i < b->count; ++i) entries += sticks_out(b, &b->bodies[i]);
    if (nodes >= GSGI_NOWHERE || entries >= GSGI_NOWHERE) return false;
    lists->nodes = (uint32_t)nodes;
    lists->entries = (uint32_t)entries;
    lists->first = gsgi__tree_take(b, lists->nodes + 1, 4);
    lists->child = gsgi__tree_take(b, lists->nodes, 4);
    lists->entry = gsgi__tree_take(b, lists->entries, 4);
    lists->octants = gsgi__tree_take(b, lists->entries, 1);
    if (!lists->first || !lists->child || !lists->entry || !lists->octants) return false;

    /* Count, then place. The number of a node of depth l: `begin` of the depth and its own. */
    for (int pass = 0; pass < 2; ++pass) {
        uint32_t begin = 0;
        for (int l = 0; l < b->used; ++l) {
            const gsgi__depth* d = &b->depths[l];
            const uint32_t below = begin + d->nodes + (l == 0);
            for (uint32_t i = 0; i < d->nodes; ++i)
                lists->child[begin + i] = d->child[i] == GSGI_NOWHERE ? 0 : below + d->child[i];
            for (uint32_t i = 0; i < d->count; ++i) {
                const gsgi__pair* p = &d->pairs[i];
                if (!p->listed) continue;
                uint32_t* at = &lists->first[begin + p->node];
                if (pass) lists->entry[*at] = b->bodies[p->body].gaussian, lists->octants[*at] = p->octants;
                ++*at;
            }
            if (l == 0) {
                for (uint32_t i = 0; i < b->count; ++i) {
                    if (!sticks_out(b, &b->bodies[i])) continue;
                    uint32_t* at = &lists->first[roots];
                    if (pass) lists->entry[*at] = b->bodies[i].gaussian, lists->octants[*at] = 255;
                    ++*at;
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
                             double radius, uint32_t price) {
    gsgi__tree b = {.callbacks = callbacks, .edge = 1.0f};
    bool built = (b.bodies = gsgi__tree_take(&b, level->count, sizeof *b.bodies)) != NULL;
    memset(lists, 0, sizeof *lists);
    for (uint32_t i = 0; built && i < level->count; ++i)
        if (level->shape.texels[(size_t)i * GSGI_SHAPE_FLOATS + 3] > 0.0f) b.bodies[b.count++].gaussian = i;
    if (built && b.count > 0) built = gsgi__tree_create(&b, level, radius, price) && mark_listed(&b);
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
    gsgi__release(callbacks, lists->octants);
    memset(lists, 0, sizeof *lists);
}
