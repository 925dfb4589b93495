/* Which Gaussians reach each cell of a grid, for points on the CPU. */
#include "internal.h"
#include "lib/constants.glsl"

#include <math.h>
#include <string.h>

#define CELLS_MAX 32      /* along the longest axis */
#define LIST_PER_COUNT 64 /* a grid whose lists would be longer, per Gaussian, gets larger cells */

void gsgi__axes(const float* q, float axes[3][3]) {
    const float x = q[0], y = q[1], z = q[2], w = q[3];
    const float rotated[3][3] = {{1.0f - 2.0f * (y * y + z * z), 2.0f * (x * y + w * z), 2.0f * (x * z - w * y)},
                                 {2.0f * (x * y - w * z), 1.0f - 2.0f * (x * x + z * z), 2.0f * (y * z + w * x)},
                                 {2.0f * (x * z + w * y), 2.0f * (y * z - w * x), 1.0f - 2.0f * (x * x + y * y)}};
    memcpy(axes, rotated, sizeof rotated);
}

/* Standard deviation along an axis, m, as the operator reads it. */
static float scale_of(const float* shape, int axis) {
    return fminf(fmaxf(shape[8 + axis], (float)SCALE_MIN), (float)SCALE_MAX);
}

gsgi__kernel gsgi__kernel_of(const float* shape) {
    gsgi__kernel kernel;
    float axes[3][3];
    gsgi__axes(shape + 4, axes);
    memcpy(kernel.center, shape, sizeof kernel.center);
    kernel.opacity = shape[3];
    for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k) kernel.whiten[j][k] = axes[j][k] / scale_of(shape, j);
    return kernel;
}

/* Half the size of the ellipsoid's bounding box, a little enlarged against rounding. */
static void half_extent(const float* shape, float radius, double extent[3]) {
    float axes[3][3];
    gsgi__axes(shape + 4, axes);
    for (int k = 0; k < 3; ++k) {
        double squares = 0.0;
        for (int j = 0; j < 3; ++j) {
            const double part = (double)axes[j][k] * scale_of(shape, j);
            squares += part * part;
        }
        extent[k] = 1.00001 * radius * sqrt(squares) + 1e-6 * fabs((double)shape[k]);
    }
}

static int32_t cell_of(const gsgi__grid* grid, int axis, double x) {
    double cell = floor((x - grid->low[axis]) * grid->per_cell[axis]);
    return cell < 0.0 ? 0 : cell >= grid->cells[axis] ? grid->cells[axis] - 1 : (int32_t)cell;
}

size_t gsgi__grid_cell(const gsgi__grid* grid, const double x[3]) {
    const size_t row = (size_t)cell_of(grid, 2, x[2]) * grid->cells[1] + cell_of(grid, 1, x[1]);
    return row * grid->cells[0] + cell_of(grid, 0, x[0]);
}

/* Cells that the Gaussian's bounding box touches: first[k] ... last[k]. Returns how many. */
static uint64_t cells_of(const gsgi__grid* grid, const float* shape, float radius, int32_t first[3], int32_t last[3]) {
    double extent[3];
    uint64_t cells = 1;
    half_extent(shape, radius, extent);
    for (int k = 0; k < 3; ++k) {
        first[k] = cell_of(grid, k, shape[k] - extent[k]);
        last[k] = cell_of(grid, k, shape[k] + extent[k]);
        cells *= (uint64_t)(last[k] - first[k] + 1);
    }
    return cells;
}

static void divide(gsgi__grid* grid, int32_t along_longest) {
    double longest = 0.0;
    for (int k = 0; k < 3; ++k) longest = fmax(longest, grid->high[k] - grid->low[k]);
    for (int k = 0; k < 3; ++k) {
        double size = grid->high[k] - grid->low[k];
        grid->cells[k] = longest > 0.0 ? (int32_t)ceil(along_longest * size / longest) : 1;
        if (grid->cells[k] < 1) grid->cells[k] = 1;
        grid->per_cell[k] = size > 0.0 ? grid->cells[k] / size : 0.0;
    }
}

/* Divide the grid into as many cells as its lists may hold. Returns the length of all lists. */
static uint64_t choose_cells(gsgi__grid* grid, const gsgi__level* level, float radius) {
    uint64_t limit = (uint64_t)level->count * LIST_PER_COUNT, entries = 0;
    for (int32_t along_longest = CELLS_MAX;; along_longest /= 2) {
        int32_t first[3], last[3];
        divide(grid, along_longest);
        entries = 0;
        for (size_t i = 0; i < level->count && entries <= limit; ++i)
            entries += cells_of(grid, level->shape.texels + i * GSGI_SHAPE_FLOATS, radius, first, last);
        if (entries <= limit) return entries; /* in a single cell they are `count` */
    }
}

/* Fill the lists by counting: first each cell's length, then where it begins, then the Gaussians in their order. */
static void fill_lists(gsgi__grid* grid, const gsgi__level* level, float radius) {
    const size_t cells = (size_t)grid->cells[0] * grid->cells[1] * grid->cells[2];
    memset(grid->begin, 0, (cells + 1) * sizeof *grid->begin);
    for (int counting = 1; counting >= 0; --counting) {
        for (size_t i = 0; i < level->count; ++i) {
            int32_t first[3], last[3];
            cells_of(grid, level->shape.texels + i * GSGI_SHAPE_FLOATS, radius, first, last);
            for (int32_t z = first[2]; z <= last[2]; ++z)
                for (int32_t y = first[1]; y <= last[1]; ++y)
                    for (int32_t x = first[0]; x <= last[0]; ++x) {
                        size_t cell = ((size_t)z * grid->cells[1] + y) * grid->cells[0] + x;
                        if (counting)
                            ++grid->begin[cell];
                        else
                            grid->index[grid->begin[cell]++] = (uint32_t)i;
                    }
        }
        uint32_t sum = 0, previous = 0;
        for (size_t cell = 0; cell <= cells; ++cell) {
            uint32_t here = grid->begin[cell];
            grid->begin[cell] = counting ? sum : previous; /* filling has moved each begin to its end */
            sum += here;
            previous = here;
        }
    }
}

bool gsgi__grid_create(gsgi__grid* grid, const gsgi_callbacks* callbacks, const gsgi__level* level, float radius) {
    if (level->count == 0) return true;
    for (int k = 0; k < 3; ++k) grid->low[k] = HUGE_VAL, grid->high[k] = -HUGE_VAL;
    for (size_t i = 0; i < level->count; ++i) {
        const float* shape = level->shape.texels + i * GSGI_SHAPE_FLOATS;
        double extent[3];
        half_extent(shape, radius, extent);
        for (int k = 0; k < 3; ++k) {
            grid->low[k] = fmin(grid->low[k], shape[k] - extent[k]);
            grid->high[k] = fmax(grid->high[k], shape[k] + extent[k]);
        }
    }
    uint64_t entries = choose_cells(grid, level, radius);
    const size_t cells = (size_t)grid->cells[0] * grid->cells[1] * grid->cells[2];
    const size_t kernel_bytes = level->count * sizeof(gsgi__kernel), begin_bytes = (cells + 1) * sizeof *grid->begin;
    if (entries > SIZE_MAX / 8) return false;
    grid->kernels = gsgi__allocate(callbacks, kernel_bytes);
    grid->begin = gsgi__allocate(callbacks, begin_bytes);
    grid->index = gsgi__allocate(callbacks, (size_t)entries * sizeof *grid->index);
    if (!grid->kernels || !grid->begin || !grid->index) return false;
    grid->bytes = kernel_bytes + begin_bytes + (size_t)entries * sizeof *grid->index;
    for (size_t i = 0; i < level->count; ++i)
        grid->kernels[i] = gsgi__kernel_of(level->shape.texels + i * GSGI_SHAPE_FLOATS);
    fill_lists(grid, level, radius);
    return true;
}

void gsgi__grid_destroy(gsgi__grid* grid, const gsgi_callbacks* callbacks) {
    gsgi__release(callbacks, grid->kernels);
    gsgi__release(callbacks, grid->begin);
    gsgi__release(callbacks, grid->index);
}
