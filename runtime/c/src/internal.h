/* What the sources share. Names that begin with gsgi__ are private. */
#ifndef GSGI_INTERNAL_H
#define GSGI_INTERNAL_H

#include "gsgi.h"

#include <stdbool.h>

#if defined(__GNUC__)
#define GSGI_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define GSGI_PRINTF(text, first)
#endif

/* ---- options.c ---- */

void* gsgi__allocate(const gsgi_callbacks* callbacks, size_t size);
void gsgi__release(const gsgi_callbacks* callbacks, void* memory);
void gsgi__log(const gsgi_callbacks* callbacks, gsgi_severity severity, const char* format, ...) GSGI_PRINTF(3, 4);

/* Log an error and return `result`. */
gsgi_result gsgi__fail(const gsgi_callbacks* callbacks, gsgi_result result, const char* format, ...) GSGI_PRINTF(3, 4);

/* Read a host's options, of whichever version, into `own`; NULL stands for zeros. */
gsgi_result gsgi__read_options(const void* given, void* own, size_t own_size);

/* Write as much of the struct `own` as the host's struct, of whichever version, has room for. */
gsgi_result gsgi__write_struct(const void* own, size_t own_size, void* given);

/* ---- bake.c ---- */

#define GSGI_DATA_WIDTH 2048 /* texels; DATA_WIDTH of glsl/lib/gaussian.glsl */
#define GSGI_SHAPE_FLOATS 12 /* per Gaussian: three texels */
#define GSGI_RELIEF_FLOATS 12

typedef struct gsgi__texels {
    float* texels;   /* NULL without any */
    uint32_t floats; /* per Gaussian, a multiple of 4 */
    uint32_t rows;
} gsgi__texels;

static inline size_t gsgi__texel_bytes(const gsgi__texels* data) {
    return (size_t)data->rows * GSGI_DATA_WIDTH * 4 * sizeof(float);
}

typedef struct gsgi__level {
    uint32_t count, sh_degree;
    bool sloped;
    gsgi__texels shape, sh, slope, relief; /* the last of the fine level, where the file has it */
} gsgi__level;

/* The light of a light group on the Gaussians of both levels, one after the other: no rows. */
typedef struct gsgi__group {
    char* name;
    gsgi__texels sh[2], slope, relief; /* the latter two of the fine level; relief in `own` alone */
} gsgi__group;

/* What decides the weight of a Gaussian. */
typedef struct gsgi__kernel {
    float center[3]; /* m, relative to the bake's origin */
    float opacity;
    float whiten[3][3]; /* rows: the ellipsoid's axes over their standard deviations, 1/m */
} gsgi__kernel;

/* A grid of the Gaussians that reach into each cell; see grid.c. */
typedef struct gsgi__grid {
    gsgi__kernel* kernels; /* one per Gaussian; NULL: there is no grid */
    uint32_t* begin;       /* of each cell's part of `index`; one more marks the end */
    uint32_t* index;
    double low[3], high[3], per_cell[3]; /* m, relative to the bake's origin; cells per m */
    int32_t cells[3];
    size_t bytes;
} gsgi__grid;

struct gsgi_bake {
    gsgi_callbacks callbacks;
    gsgi_info info;
    double origin[3]; /* m; positions are relative to it */
    gsgi__level levels[2];
    gsgi__grid grids[2];
    gsgi_lookup* lookup; /* of a sector of a world, or opened with `lists`; else NULL */
    bool in_world;       /* whether it is a sector */
    uint32_t crc;        /* of the file */
    gsgi__group* groups;
    gsgi__group own; /* the light of the levels where all weights are 1; only where there are groups */
};

/* ---- grid.c ---- */

/* The grid of a level; `radius` in standard deviations. Returns false if there is no memory. */
bool gsgi__grid_create(gsgi__grid* grid, const gsgi_callbacks* callbacks, const gsgi__level* level, float radius);
void gsgi__grid_destroy(gsgi__grid* grid, const gsgi_callbacks* callbacks);

/* The cell that holds a point, m, which must lie within the grid. */
size_t gsgi__grid_cell(const gsgi__grid* grid, const double x[3]);

gsgi__kernel gsgi__kernel_of(const float* shape);

/* Columns of the rotation matrix of the quaternion xyzw: axes[0] is the rotated x axis (Shoemake 1985). */
void gsgi__axes(const float* quaternion, float axes[3][3]);

/* ---- view.c ---- */

/* Rows first. */
typedef struct gsgi__matrix {
    double at[4][4];
} gsgi__matrix;

/* A camera as the passes need it. */
typedef struct gsgi__camera {
    gsgi__matrix view_from_world, world_from_view;    /* relative to the bake's origin; looks down -z, right-handed */
    gsgi__matrix world_from_host;                     /* the host's own view space */
    bool parallel;                                    /* whether the projection is orthographic */
    double fx, fy, cx, cy;                            /* px (px/m if parallel); rows go down; negative: mirrored */
    float depth_ends[2], depth_line[2], z_to_clip[2]; /* DepthCode of glsl/surface/host.glsl */
    int32_t x, y, width, height;                      /* px, of the viewport */
} gsgi__camera;

gsgi_result gsgi__camera_of_view(const gsgi_view* view, const gsgi_light_options* options, const double origin[3],
                                 const gsgi_callbacks* callbacks, gsgi__camera* camera);

/* ---- cull.c ---- */

/* Whether a ball, centre and radius in m, reaches into the pyramid of the view. One of the radius NaN does not. */
bool gsgi__in_view(const gsgi__camera* camera, const float ball[4]);

/* What culling needs of the Gaussians of the `over` operator, and what it found. */
typedef struct gsgi__culled {
    uint32_t count, visible;
    float *x, *y, *z, *radius; /* m; beyond the radius a Gaussian has no weight. All in one block, which x begins. */
    uint32_t* index;           /* the visible ones */
    uint32_t *keys, *sorted_index, *sorted_keys; /* to sort */
} gsgi__culled;

/* Returns false if there is no memory. */
bool gsgi__culled_create(gsgi__culled* culled, const gsgi_callbacks* callbacks, const gsgi__level* level,
                         const gsgi_info* info);
void gsgi__culled_destroy(gsgi__culled* culled, const gsgi_callbacks* callbacks);

/* Gaussians that may be visible in the image, farthest first; at equal depth the earlier one is in front. */
void gsgi__cull_and_sort(gsgi__culled* culled, const gsgi__camera* camera, const gsgi_info* info);

#endif
