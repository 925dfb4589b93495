/* B at points, on the CPU: the `surface` operator over the Gaussians in the point's cell of a grid. */
#include "internal.h"
#include "lib/constants.glsl"

#include <math.h>
#include <string.h>

static float clamped(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

/* A surface point. */
typedef struct point {
    double x[3];                    /* m, relative to the bake's origin */
    float place[3], n[3], basis[9]; /* x as floats; unit normal; the SH basis there */
    float bend[3];                  /* by which a normal map changes the normal */
} point;

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

/* Sums over Gaussians at a point: w c, w, and what w c has more where a normal map bends the normal. */
typedef struct totals {
    float light[3], weight, relief[3];
} totals;

/* Add those of Gaussian `i`, as glsl/surface/lookup.glsl does. `sharpness` 0: it faces every direction. */
static void add_gaussian(const gsgi__level* level, const gsgi__kernel* kernel, size_t i, const gsgi_info* info,
                         uint32_t sharpness, const point* at, totals* to) {
    const float *n = at->n, *basis = at->basis;
    float offset[3], e[3], light[3], squares = 0.0f;
    for (int k = 0; k < 3; ++k) offset[k] = at->place[k] - kernel->center[k];
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
    float constant[3];
    for (int c = 0; c < 3; ++c) light[c] = basis[0] * (constant[c] = clamped(sh[c], -limit, limit));
    for (uint32_t k = 1; k < coefficients; ++k)
        for (int c = 0; c < 3; ++c) light[c] += basis[k] * clamped(sh[3 * k + c], -limit, limit);
    if (level->sloped) {
        const float* slope = level->slope.texels + 4 * i;
        const float along[2] = {clamped(slope[0], -1.0f, 1.0f), clamped(slope[1], -1.0f, 1.0f)};
        for (int c = 0; c < 3; ++c) light[c] += (along[0] * e[0] + along[1] * e[1]) * basis[0] * constant[c];
    }
    const gsgi__texels* relief = &level->relief;
    for (uint32_t k = 0; k < relief->floats; k += 4)
        for (uint32_t c = 0; c < 3; ++c)
            to->relief[c] += w * at->bend[k / 4] *
                             clamped(relief->texels[i * relief->floats + k + c], -(float)HALF_MAX, (float)HALF_MAX);
    for (int c = 0; c < 3; ++c) to->light[c] += w * light[c];
    to->weight += w;
}

/* The sums over a level at a point. */
static totals level_sums(const gsgi_bake* bake, int l, uint32_t sharpness, const point* at) {
    const gsgi__level* level = &bake->levels[l];
    const gsgi__grid* grid = &bake->grids[l];
    totals sums = {{0.0f}, 0.0f, {0.0f}};
    if (!grid->kernels) {
        for (size_t i = 0; i < level->count; ++i) {
            gsgi__kernel kernel = gsgi__kernel_of(level->shape.texels + i * GSGI_SHAPE_FLOATS);
            add_gaussian(level, &kernel, i, &bake->info, sharpness, at, &sums);
        }
        return sums;
    }
    for (int k = 0; k < 3; ++k)
        if (!(at->x[k] >= grid->low[k] && at->x[k] <= grid->high[k])) return sums; /* NaN too */
    const size_t cell = gsgi__grid_cell(grid, at->x);
    for (uint32_t listed = grid->begin[cell]; listed < grid->begin[cell + 1]; ++listed) {
        uint32_t i = grid->index[listed];
        add_gaussian(level, &grid->kernels[i], i, &bake->info, sharpness, at, &sums);
    }
    return sums;
}

/* One channel of w c with the relief, as bent() of glsl/surface/weight.glsl has it. */
static float with_relief(float light, float relief) {
    const float l = fmaxf(light, 0.0f);
    return relief < -0.5f * l ? -0.25f * l * l / relief : light + relief;
}

/* Write `given` at the length 1; false if it has none that could be 1. */
static bool unit(const float given[3], float to[3]) {
    const double length = sqrt((double)given[0] * given[0] + (double)given[1] * given[1] + (double)given[2] * given[2]);
    if (!(length > 0.0 && isfinite(length))) return false;
    for (int k = 0; k < 3; ++k) to[k] = (float)(given[k] / length);
    return true;
}

/* How a point is read: by both levels, as the surface of a scene, or by the coarse one, as what moves in it. */
typedef enum { SURFACE, FREE } reading;

/* Sums of w c and w of both levels at a surface point; the coarse one has the light of all normals: that of `bent`. */
static totals surface_sums(const gsgi_bake* bake, point* at, const float bent[3]) {
    totals sums = level_sums(bake, GSGI_FINE, bake->info.sharpness, at);
    if (bake->info.relief)
        for (int c = 0; c < 3; ++c) sums.light[c] = with_relief(sums.light[c], sums.relief[c]);
    const float gap = fmaxf(0.0f, bake->info.weight_floor - sums.weight);
    if (!(gap > 0.0f)) return sums;
    if (memcmp(bent, at->n, sizeof at->n)) sh_basis(bent, at->basis);
    const totals coarse = level_sums(bake, GSGI_COARSE, 0, at);
    for (int c = 0; c < 3 && coarse.weight > 0.0f; ++c) sums.light[c] += gap * (coarse.light[c] / coarse.weight);
    sums.weight += gap;
    return sums;
}

static gsgi_result sample(const gsgi_bake* bake, reading how, size_t count, const float* positions,
                          const float* normals, const float* mapped, float* light) {
    if (bake->info.blend != GSGI_SURFACE)
        return gsgi__fail(&bake->callbacks, GSGI_UNSUPPORTED,
                          "bake: light of the operator over is no function of points");
    if (count && (!positions || !normals || !light))
        return gsgi__fail(&bake->callbacks, GSGI_INVALID_ARGUMENT, "positions, normals, light: must not be NULL");
    for (size_t p = 0; p < count; ++p) {
        point at;
        float bent[3];
        memset(light + 3 * p, 0, 3 * sizeof *light);
        if (!unit(normals + 3 * p, at.n)) continue;
        memcpy(bent, at.n, sizeof bent);
        if (mapped && bake->info.relief) unit(mapped + 3 * p, bent);
        for (int k = 0; k < 3; ++k) {
            at.x[k] = (double)positions[3 * p + k] - bake->origin[k];
            at.place[k] = (float)at.x[k];
            at.bend[k] = bent[k] - at.n[k];
        }
        sh_basis(at.n, at.basis);
        const totals sums = how == SURFACE ? surface_sums(bake, &at, bent) : level_sums(bake, GSGI_COARSE, 0, &at);
        for (int c = 0; c < 3; ++c) {
            float b = sums.weight > 0.0f ? sums.light[c] / sums.weight : 0.0f;
            light[3 * p + c] = b > 0.0f ? fminf(b, (float)HALF_MAX) : 0.0f; /* NaN is 0 */
        }
    }
    return GSGI_OK;
}

gsgi_result gsgi_bake_sample(const gsgi_bake* bake, size_t count, const float* positions, const float* normals,
                             float* light) {
    return sample(bake, SURFACE, count, positions, normals, NULL, light);
}

gsgi_result gsgi_bake_sample_mapped(const gsgi_bake* bake, size_t count, const float* positions, const float* normals,
                                    const float* mapped, float* light) {
    return sample(bake, SURFACE, count, positions, normals, mapped, light);
}

gsgi_result gsgi_bake_sample_free(const gsgi_bake* bake, size_t count, const float* positions, const float* normals,
                                  float* light) {
    return sample(bake, FREE, count, positions, normals, NULL, light);
}
