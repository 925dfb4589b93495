/* The octree of cell_lists.c while it is built. All arithmetic is that of runtime/cell_lists.py. */
#ifndef GSGI_CELL_TREE_H
#define GSGI_CELL_TREE_H

#include "internal.h"

#define GSGI_CELLS_SLACK 1e-4 /* of a root's edge and of an ellipsoid's radius; covers the rounding of floats */
#define GSGI_DEPTH_MAX 20     /* splits of a root; floats within it have 24 bits */
#define GSGI_BODY_POINTS 16   /* where light is read: four by four on the plane of each ellipsoid */
#define GSGI_NOWHERE UINT32_MAX

/* ---- cell_bodies.c ---- */

/* An ellipsoid; lengths are relative to the low corner of the grid, m. */
typedef struct gsgi__body {
    uint32_t gaussian;
    float centre[3];
    float bound[3];   /* half the bounding box */
    float reach;      /* the square of the shortest semi-axis */
    float inverse[6]; /* xx, xy, xz, yy, yz, zz of the inverse covariance, times the square of the shortest deviation */
    float reciprocal[3]; /* of xx, yy, zz */
    float length;        /* the longest semi-axis */
} gsgi__body;

/* Standard deviation along an axis, m, as the operator reads it. */
float gsgi__body_scale(const float* shape, int axis);

/* Fill in all but the length and the index of a Gaussian, of which `shape` are the texels, and points of its plane. */
void gsgi__body_make(const float low[3], const float* shape, double radius, gsgi__body* to,
                     float points[GSGI_BODY_POINTS][3]);

/* Which of eight cubes a body meets, a bit for each, the first the lowest. `offset` is from their middles to the body's
 * centre. */
uint8_t gsgi__body_meets(const gsgi__body* a, float offset[3][8], float half);

/* ---- cell_tree.c ---- */

/* A body that reaches a node. */
typedef struct gsgi__pair {
    uint32_t body, node, parent; /* parent: the pair of the depth above */
    float crowd;                 /* points in the octants that it reaches */
    uint8_t octants;             /* a bit for each of these */
    bool pushed;                 /* whether it may be listed in the children */
    bool listed, above;          /* whether it is listed here; whether it is here or above */
} gsgi__pair;

/* Nodes of one depth, and pairs. */
typedef struct gsgi__depth {
    uint32_t count, room, nodes; /* room: pairs for which there is memory */
    gsgi__pair* pairs;
    float (*middle)[3]; /* per node */
    uint32_t* child;    /* per node: the first of the eight of the depth below; GSGI_NOWHERE: a leaf */
} gsgi__depth;

/* A point where light is read: its node, where it lies in it, 0 ... 1, and then its octant. */
typedef struct gsgi__reading {
    float part[3];
    uint32_t node, octant;
} gsgi__reading;

typedef struct gsgi__tree {
    const gsgi_callbacks* callbacks;
    gsgi__body* bodies;
    uint32_t count;
    gsgi__reading* readings;
    size_t reading_count;
    float low[3], edge;
    float price; /* of an entry, in reads */
    int32_t size[3];
    gsgi__depth depths[GSGI_DEPTH_MAX + 1];
    int used; /* depths */
} gsgi__tree;

/* Memory that is 0. */
void* gsgi__tree_take(const gsgi__tree* b, size_t count, size_t size);

/* All depths, from the grid's cells to those that need no split, for bodies that know their Gaussians. Returns false if
 * there is no memory. */
bool gsgi__tree_create(gsgi__tree* b, const gsgi__level* level, double radius, uint32_t price);
void gsgi__tree_destroy(gsgi__tree* b);

#endif
