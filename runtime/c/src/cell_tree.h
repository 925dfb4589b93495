/* The octree of cell_lists.c while it is built. All arithmetic is that of runtime/cell_lists.py. */
#ifndef GSGI_CELL_TREE_H
#define GSGI_CELL_TREE_H

#include "internal.h"

#define GSGI_CELLS_SLACK 1e-5 /* of a root's edge and of an ellipsoid's radius; covers the rounding of floats */
#define GSGI_DEPTH_MAX 20     /* splits of a root; floats within it have 24 bits */
#define GSGI_NOWHERE UINT32_MAX

/* ---- cell_bodies.c ---- */

/* An ellipsoid; lengths are relative to the low corner of the grid, m. The shortest axis comes first. */
typedef struct gsgi__body {
    uint32_t gaussian;
    float centre[3];
    float whiten[3][3]; /* the axes, times the shortest deviation over theirs */
    float inverse[3];   /* 1 / the square of the length of what each coordinate becomes */
    float bound[3];     /* half the bounding box */
    float reach;        /* the shortest semi-axis */
    float length;       /* the longest */
} gsgi__body;

/* Standard deviation along an axis, m, as the operator reads it. */
float gsgi__body_scale(const float* shape, int axis);

/* Fill in all but the length and the index of a Gaussian, of which `shape` are the texels. */
void gsgi__body_make(const float low[3], const float* shape, double radius, gsgi__body* to);

/* Whether a body meets a cube; `offset` is from the cube's middle to the body's centre. */
bool gsgi__body_meets(const gsgi__body* a, const float offset[3], float half);

/* ---- cell_tree.c ---- */

/* Nodes of one depth, and pairs of a node and a body that reaches it. */
typedef struct gsgi__depth {
    uint32_t pairs, room, nodes;    /* room: pairs for which there are arrays */
    uint32_t *body, *node, *parent; /* per pair; parent: the pair of the depth above */
    float (*middle)[3];             /* per node */
    uint32_t* child;                /* per node: the first of the eight of the depth below; GSGI_NOWHERE: a leaf */
    uint8_t *listed, *above;        /* per pair: whether it is listed here; whether it is here or above */
} gsgi__depth;

typedef struct gsgi__tree {
    const gsgi_callbacks* callbacks;
    gsgi__body* bodies;
    uint32_t count;
    float low[3], edge;
    float typical; /* the median of all lengths, m */
    int32_t size[3];
    gsgi__depth depths[GSGI_DEPTH_MAX + 1];
    int used; /* depths */
} gsgi__tree;

/* Memory that is 0. */
void* gsgi__tree_take(const gsgi__tree* b, size_t count, size_t size);

/* All depths, from the grid's cells to those that need no split, for bodies that know their Gaussians. Returns false if
 * there is no memory. */
bool gsgi__tree_create(gsgi__tree* b, const gsgi__level* level, double radius);
void gsgi__tree_destroy(gsgi__tree* b);

#endif
