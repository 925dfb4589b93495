/* Ellipsoids and the cubes that they meet. */
#include "cell_tree.h"
#include "lib/constants.glsl"

#include <math.h>

#define FLATTEST 16.0f /* longest over shortest axis in the tests, where floats could not hold the squares of more */

static float dot3(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static float clamped(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

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
        for (int k = j; k < 3; ++k) to->inverse[at++] = dot3(whiten[j], whiten[k]);
    to->reach = reach * deviation[0] * (reach * deviation[0]);
}

/* They do not if a plane parts them: one across an axis, or across the gradient of the distance in standard deviations.
 * The latter is taken at a point of the cube where that distance is near its least: after one round of descent along
 * the axes, from the point nearest to the body's centre. */
bool gsgi__body_meets(const gsgi__body* a, const float offset[3], float half) {
    const float* m = a->inverse;
    const float rows[3][3] = {{m[0], m[1], m[2]}, {m[1], m[3], m[4]}, {m[2], m[4], m[5]}};
    float at[3], across[3]; /* at: from the point to the centre */
    for (int k = 0; k < 3; ++k) {
        if (fabsf(offset[k]) - half > a->bound[k]) return false;
        at[k] = offset[k] - clamped(offset[k], -half, half);
    }
    for (int k = 0; k < 3; ++k)
        at[k] = clamped(at[k] - dot3(rows[k], at) / rows[k][k], offset[k] - half, offset[k] + half);
    for (int k = 0; k < 3; ++k) across[k] = dot3(rows[k], at);
    const float gap = dot3(across, offset) - half * (fabsf(across[0]) + fabsf(across[1]) + fabsf(across[2]));
    return !(gap > sqrtf(a->reach * dot3(across, at)));
}
