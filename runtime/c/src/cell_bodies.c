/* Ellipsoids and the cubes that they meet. */
#include "cell_tree.h"
#include "lib/constants.glsl"

#include <float.h>
#include <math.h>
#include <string.h>

static float dot3(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static float clamped(float x, float half) { return x < -half ? -half : x > half ? half : x; }

float gsgi__body_scale(const float* shape, int axis) {
    return fminf(fmaxf(shape[8 + axis], (float)SCALE_MIN), (float)SCALE_MAX);
}

void gsgi__body_make(const float low[3], const float* shape, double radius, gsgi__body* to) {
    const float reach_of_one = (float)(radius * (1.0 + GSGI_CELLS_SLACK));
    float axes[3][3], deviation[3];
    int order[3] = {0, 1, 2};
    for (int i = 1; i < 3; ++i) /* insertion sort: stable */
        for (int j = i; j > 0 && gsgi__body_scale(shape, order[j]) < gsgi__body_scale(shape, order[j - 1]); --j) {
            const int other = order[j];
            order[j] = order[j - 1];
            order[j - 1] = other;
        }
    gsgi__axes(shape + 4, axes);
    for (int i = 0; i < 3; ++i) {
        deviation[i] = gsgi__body_scale(shape, order[i]);
        for (int j = 0; j < 3; ++j) to->whiten[i][j] = axes[order[i]][j] * (deviation[0] / deviation[i]);
    }
    for (int j = 0; j < 3; ++j) {
        float squares = 0.0f;
        for (int i = 0; i < 3; ++i) {
            const float axis = axes[order[i]][j], reach = reach_of_one * deviation[i];
            squares += axis * axis * (reach * reach);
        }
        to->bound[j] = sqrtf(squares);
        to->centre[j] = shape[j] - low[j];
        const float column[3] = {to->whiten[0][j], to->whiten[1][j], to->whiten[2][j]};
        to->inverse[j] = 1.0f / fmaxf(dot3(column, column), FLT_MIN);
    }
    to->reach = reach_of_one * deviation[0];
}

/* They do if the cube's point nearest to the centre lies within. Else they are apart if a plane parts them. The best
 * plane is that across the gradient, at the cube's point nearest to the centre in standard deviations, of which a round
 * of descent along the axes comes close enough (Hildreth 1957). */
bool gsgi__body_meets(const gsgi__body* a, const float offset[3], float half) {
    float point[3], away[3], white[3], across[3];
    for (int k = 0; k < 3; ++k) {
        point[k] = clamped(offset[k], half);
        away[k] = point[k] - offset[k];
    }
    for (int i = 0; i < 3; ++i) white[i] = dot3(a->whiten[i], away);
    if (dot3(white, white) <= a->reach * a->reach) return true;
    for (int k = 0; k < 3; ++k) {
        const float column[3] = {a->whiten[0][k], a->whiten[1][k], a->whiten[2][k]};
        const float step = clamped(point[k] - dot3(column, white) * a->inverse[k], half) - point[k];
        for (int i = 0; i < 3; ++i) white[i] = white[i] + column[i] * step;
    }
    for (int j = 0; j < 3; ++j)
        across[j] = a->whiten[0][j] * white[0] + a->whiten[1][j] * white[1] + a->whiten[2][j] * white[2];
    const float gap = -dot3(across, offset) - half * (fabsf(across[0]) + fabsf(across[1]) + fabsf(across[2]));
    return !(gap > a->reach * sqrtf(dot3(white, white)));
}
