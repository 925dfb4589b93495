/* Ellipsoids and the cubes that they meet. */
#include "cell_tree.h"
#include "lib/constants.glsl"

#include <math.h>

#define FLATTEST 16.0f /* longest over shortest axis in the tests, where floats could not hold the squares of more */

static float dot3(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static float clamped(float x, float low, float high) {
    const float most = x < high ? x : high;
    return most > low ? most : low;
}

float gsgi__body_scale(const float* shape, int axis) {
    return fminf(fmaxf(shape[8 + axis], (float)SCALE_MIN), (float)SCALE_MAX);
}

void gsgi__body_make(const float low[3], const float* shape, double radius, gsgi__body* to,
                     float points[GSGI_BODY_POINTS][3]) {
    static const float steps[4] = {-1.2f, -0.4f, 0.4f, 1.2f}; /* deviations */
    const float reach = (float)(radius * (1.0 + GSGI_CELLS_SLACK));
    float axes[3][3], deviation[3], whiten[3][3];
    int order[3] = {0, 1, 2};
    for (int i = 1; i < 3; ++i) /* insertion sort: stable */
        for (int j = i; j > 0 && gsgi__body_scale(shape, order[j]) < gsgi__body_scale(shape, order[j - 1]); --j) {
            const int other = order[j];
            order[j] = order[j - 1];
            order[j - 1] = other;
        }
    gsgi__axes(shape + 4, axes);
    for (int i = 0; i < 3; ++i) deviation[i] = gsgi__body_scale(shape, order[i]);
    for (int j = 0; j < 3; ++j) {
        float squares = 0.0f;
        for (int i = 0; i < 3; ++i) {
            const float side = axes[order[i]][j] * (reach * deviation[i]);
            squares += side * side;
        }
        to->bound[j] = sqrtf(squares);
        to->centre[j] = shape[j] - low[j];
        for (int p = 0; p < GSGI_BODY_POINTS; ++p)
            points[p][j] = to->centre[j] + steps[p / 4] * (axes[order[1]][j] * deviation[1]) +
                           steps[p % 4] * (axes[order[2]][j] * deviation[2]);
    }
    for (int i = 0; i < 3; ++i) deviation[i] = fmaxf(deviation[i], gsgi__body_scale(shape, order[2]) / FLATTEST);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) whiten[j][i] = axes[order[i]][j] * (deviation[0] / deviation[i]);
    for (int j = 0, at = 0; j < 3; ++j)
        for (int k = j; k < 3; ++k) {
            to->inverse[at] = dot3(whiten[j], whiten[k]);
            if (k == j) to->reciprocal[j] = 1.0f / to->inverse[at];
            ++at;
        }
    to->reach = reach * deviation[0] * (reach * deviation[0]);
}

/* A body does not meet a cube if a plane parts them: one across an axis, or across the gradient of the distance in
 * standard deviations. The latter is taken at a point of the cube where that distance is near its least: after one
 * round of descent along the axes, from the point nearest to the body's centre. The loop has no branches, so that
 * compilers compute several cubes at once. */
uint8_t gsgi__body_meets(const gsgi__body* a, float offset[3][8], float half) {
    const float xx = a->inverse[0], xy = a->inverse[1], xz = a->inverse[2];
    const float yy = a->inverse[3], yz = a->inverse[4], zz = a->inverse[5];
    const float per_xx = a->reciprocal[0], per_yy = a->reciprocal[1], per_zz = a->reciprocal[2];
    const float bound_x = a->bound[0], bound_y = a->bound[1], bound_z = a->bound[2], reach = a->reach;
    int parted[8];
    for (int i = 0; i < 8; ++i) {
        const float x = offset[0][i], y = offset[1][i], z = offset[2][i];
        float u = x - clamped(x, -half, half), v = y - clamped(y, -half, half), w = z - clamped(z, -half, half);
        const int beyond = (fabsf(x) - half > bound_x) | (fabsf(y) - half > bound_y) | (fabsf(z) - half > bound_z);
        u = clamped(u - (xx * u + xy * v + xz * w) * per_xx, x - half, x + half);
        v = clamped(v - (xy * u + yy * v + yz * w) * per_yy, y - half, y + half);
        w = clamped(w - (xz * u + yz * v + zz * w) * per_zz, z - half, z + half);
        const float p = xx * u + xy * v + xz * w, q = xy * u + yy * v + yz * w, r = xz * u + yz * v + zz * w;
        const float gap = p * x + q * y + r * z - half * (fabsf(p) + fabsf(q) + fabsf(r));
        parted[i] = beyond | ((gap > 0.0f) & (gap * gap > reach * (p * u + q * v + r * w)));
    }
    uint8_t met = 0;
    for (int i = 0; i < 8; ++i) met |= (uint8_t)(!parted[i] << i);
    return met;
}
