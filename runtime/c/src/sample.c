/* B at points, on the CPU: the `surface` operator over the Gaussians in the point's cell of a grid. */
#include "internal.h"
#include "lib/constants.glsl"

#include <math.h>
#include <string.h>

#define CELLS_MAX 32      /* along the longest axis */
#define LIST_PER_COUNT 64 /* a grid whose lists would be longer, per Gaussian, gets larger cells */

/* What decides the weight of a Gaussian. */
typedef struct gsgi__kernel {
    float center[3]; /* m, relative to the bake's origin */
    float opacity;
    float whiten[3][3]; /* rows: the ellipsoid's axes over their standard deviations, 1/m */
} gsgi__kernel;

void gsgi__axes(const float* q, float axes[3][3]) {
    const float x = q[0], y = q[1], z = q[2], w = q[3];
    const float rotated[3][3] = {{1.0f - 2.0f * (y * y + z * z), 2.0f * (x * y + w * z), 2.0f * (x * z - w * y)},
                                 {2.0f * (x * y - w * z), 1.0f - 2.0f * (x * x + z * z), 2.0f * (y * z + w * x)},
                                 {2.0f * (x * z + w * y), 2.0f * (y * z - w * x), 1.0f - 2.0f * (x * x + y * y)}};
    memcpy(axes, rotated, sizeof rotated);
}

static float clamped(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

/* Standard deviation along an axis, m, as the operator reads it. */
static float scale_of(const float* shape, int axis) {
    return clamped(shape[8 + axis], (float)SCALE_MIN, (float)SCALE_MAX);
}

static gsgi__kernel kernel_of(const float* shape) {
    gsgi__kernel kernel;
    float axes[3][3];
    gsgi__axes(shape + 4, axes);
    memcpy(kernel.center, shape, sizeof kernel.center);
    kernel.opacity = shape[3];
    for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k) kernel.whiten[j][k] = axes[j][k] / scale_of(shape, j);
    return kernel;
}

/* ---- Grid ---- */

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
    for (size_t i = 0; i < level->count; ++i) grid->kernels[i] = kernel_of(level->shape.texels + i * GSGI_SHAPE_FLOATS);
    fill_lists(grid, level, radius);
    return true;
}

void gsgi__grid_destroy(gsgi__grid* grid, const gsgi_callbacks* callbacks) {
    gsgi__release(callbacks, grid->kernels);
    gsgi__release(callbacks, grid->begin);
    gsgi__release(callbacks, grid->index);
}

/* ---- The operator ---- */

/* Basis of glsl/lib/sh.glsl up to degree 2 in the unit direction `d`. */
static void sh_basis(const float d[3], float basis[9]) {
    const float xx = d[0] * d[0], yy = d[1] * d[1], zz = d[2] * d[2];
    const float c1 = (float)SH_C1, c2 = (float)SH_C2_0;
    basis[0] = (float)SH_C0;
    basis[1] = -c1 * d[1];
    basis[2] = c1 * d[2];
    basis[3] = -c1 * d[0];
    basis[4] = c2 * d[0] * d[1];
    basis[5] = -c2 * d[1] * d[2];
    basis[6] = (float)SH_C2_1 * (2.0f * zz - xx - yy);
    basis[7] = -c2 * d[0] * d[2];
    basis[8] = (float)SH_C2_2 * (xx - yy);
}

/* Add w c and w of Gaussian `i`, as glsl/surface/gaussians.frag does. `sharpness` 0: it faces every direction. */
static void add_gaussian(const gsgi__level* level, const gsgi__kernel* kernel, size_t i, const gsgi_info* info,
                         uint32_t sharpness, const float x[3], const float n[3], const float basis[9], float sums[4]) {
    float offset[3], e[3], light[3] = {0.0f, 0.0f, 0.0f}, squares = 0.0f;
    for (int k = 0; k < 3; ++k) offset[k] = x[k] - kernel->center[k];
    for (int j = 0; j < 3; ++j) {
        const float* axis = kernel->whiten[j];
        e[j] = axis[0] * offset[0] + axis[1] * offset[1] + axis[2] * offset[2];
        squares += e[j] * e[j];
    }
    if (!(squares < info->radius * info->radius)) return; /* NaN too */
    float w = kernel->opacity * fmaxf(0.0f, expf(-0.5f * squares) - info->cutoff);
    if (sharpness > 0) {
        float axes[3][3];
        gsgi__axes(level->shape.texels + i * GSGI_SHAPE_FLOATS + 4, axes);
        float cosine = fmaxf(0.0f, n[0] * axes[2][0] + n[1] * axes[2][1] + n[2] * axes[2][2]), power = cosine;
        for (uint32_t s = 1; s < sharpness; ++s) power *= cosine;
        w *= power;
    }
    if (!(w > 0.0f)) return;
    const float* sh = level->sh.texels + i * level->sh.floats;
    const float limit = (float)(HALF_MAX / SH_C0);
    const uint32_t coefficients = (level->sh_degree + 1) * (level->sh_degree + 1);
    for (uint32_t k = 0; k < coefficients; ++k)
        for (int c = 0; c < 3; ++c) light[c] += basis[k] * clamped(sh[3 * k + c], -limit, limit);
    if (level->sloped) {
        const float* slope = level->slope.texels + 4 * i;
        for (int c = 0; c < 3; ++c) light[c] += (slope[0] * e[0] + slope[1] * e[1]) * basis[0] * sh[c];
    }
    for (int c = 0; c < 3; ++c) sums[c] += w * light[c];
    sums[3] += w;
}

/* Sums of w c and w of a level at the point `x`, m, relative to the bake's origin. */
static void level_sums(const gsgi_bake* bake, int l, uint32_t sharpness, const double x[3], const float n[3],
                       const float basis[9], float sums[4]) {
    const gsgi__level* level = &bake->levels[l];
    const gsgi__grid* grid = &bake->grids[l];
    const float place[3] = {(float)x[0], (float)x[1], (float)x[2]};
    memset(sums, 0, 4 * sizeof *sums);
    if (!grid->kernels) {
        for (size_t i = 0; i < level->count; ++i) {
            gsgi__kernel kernel = kernel_of(level->shape.texels + i * GSGI_SHAPE_FLOATS);
            add_gaussian(level, &kernel, i, &bake->info, sharpness, place, n, basis, sums);
        }
        return;
    }
    for (int k = 0; k < 3; ++k)
        if (!(x[k] >= grid->low[k] && x[k] <= grid->high[k])) return; /* NaN too */
    size_t cell = ((size_t)cell_of(grid, 2, x[2]) * grid->cells[1] + cell_of(grid, 1, x[1])) * grid->cells[0] +
                  cell_of(grid, 0, x[0]);
    for (uint32_t at = grid->begin[cell]; at < grid->begin[cell + 1]; ++at) {
        uint32_t i = grid->index[at];
        add_gaussian(level, &grid->kernels[i], i, &bake->info, sharpness, place, n, basis, sums);
    }
}

gsgi_result gsgi_bake_sample(const gsgi_bake* bake, size_t count, const float* positions, const float* normals,
                             float* light) {
    if (bake->info.blend != GSGI_SURFACE)
        return gsgi__fail(&bake->callbacks, GSGI_UNSUPPORTED,
                          "bake: light of the operator over is no function of points");
    if (count && (!positions || !normals || !light))
        return gsgi__fail(&bake->callbacks, GSGI_INVALID_ARGUMENT, "positions, normals, light: must not be NULL");
    for (size_t p = 0; p < count; ++p) {
        const float* given = normals + 3 * p;
        const double length =
            sqrt((double)given[0] * given[0] + (double)given[1] * given[1] + (double)given[2] * given[2]);
        double x[3];
        float n[3], basis[9], fine[4], coarse[4];
        memset(light + 3 * p, 0, 3 * sizeof *light);
        if (!(length > 0.0 && isfinite(length))) continue;
        for (int k = 0; k < 3; ++k) n[k] = (float)(given[k] / length);
        for (int k = 0; k < 3; ++k) x[k] = (double)positions[3 * p + k] - bake->origin[k];
        sh_basis(n, basis);
        level_sums(bake, GSGI_FINE, bake->info.sharpness, x, n, basis, fine);
        const float gap = fmaxf(0.0f, bake->info.weight_floor - fine[3]);
        if (gap > 0.0f) {
            level_sums(bake, GSGI_COARSE, 0, x, n, basis, coarse);
            for (int c = 0; c < 3 && coarse[3] > 0.0f; ++c) fine[c] += gap * (coarse[c] / coarse[3]);
            fine[3] += gap;
        }
        for (int c = 0; c < 3; ++c) {
            float b = fine[3] > 0.0f ? fine[c] / fine[3] : 0.0f;
            light[3 * p + c] = b > 0.0f ? fminf(b, (float)HALF_MAX) : 0.0f; /* NaN is 0 */
        }
    }
    return GSGI_OK;
}
