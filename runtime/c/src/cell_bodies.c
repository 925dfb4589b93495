/* Ellipsoids and the cubes that they meet. */
#include "cell_tree.h"
#include "lib/constants.glsl"

#include <float.h>
#include <math.h>
#include <string.h>

#define SHEET 0.7 /* standard deviations around the centre */

static float dot3(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static float clamped(float x, float half) { return x < -half ? -half : x > half ? half : x; }

float gsgi__body_scale(const float* shape, int axis) {
    return fminf(fmaxf(shape[8 + axis], (float)SCALE_MIN), (float)SCALE_MAX);
}

void gsgi__body_make(const float low[3], const float* shape, double radius, gsgi__body* to) {
    const float reach_of_one = (float)(radius * (1.0 + GSGI_CELLS_SLACK));
    float axes[3][3], reach[3];
    int order[3] = {0, 1, 2};
    for (int i = 1; i < 3; ++i) /* insertion sort: stable */
        for (int j = i; j > 0 && gsgi__body_scale(shape, order[j]) < gsgi__body_scale(shape, order[j - 1]); --j) {
            const int other = order[j];
            order[j] = order[j - 1];
            order[j - 1] = other;
        }
    gsgi__axes(shape + 4, axes);
    for (int i = 0; i < 3; ++i) {
        to->deviation[i] = gsgi__body_scale(shape, order[i]);
        memcpy(to->axes[i], axes[order[i]], sizeof to->axes[i]);
        reach[i] = reach_of_one * to->deviation[i];
        for (int j = 0; j < 3; ++j) to->whiten[i][j] = to->axes[i][j] * (to->deviation[0] / to->deviation[i]);
    }
    for (int j = 0; j < 3; ++j) {
        float squares = 0.0f;
        for (int i = 0; i < 3; ++i) squares += to->axes[i][j] * to->axes[i][j] * (reach[i] * reach[i]);
        to->bound[j] = sqrtf(squares);
        to->centre[j] = shape[j] - low[j];
        for (int k = 0; k < 3; ++k)
            to->metric[j][k] = to->whiten[0][j] * to->whiten[0][k] + to->whiten[1][j] * to->whiten[1][k] +
                               to->whiten[2][j] * to->whiten[2][k];
    }
    to->reach = reach[0];
}

/* They are apart if a plane parts them. The best plane is that across the gradient, at the cube's point nearest to the
 * centre in standard deviations, which two rounds of descent along the axes find nearly always (Hildreth 1957). */
bool gsgi__body_meets(const gsgi__body* a, const float offset[3], float half) {
    float point[3], away[3], gradient[3], white[3], across[3];
    if (fabsf(offset[0]) <= half && fabsf(offset[1]) <= half && fabsf(offset[2]) <= half) return true;
    for (int k = 0; k < 3; ++k) {
        point[k] = clamped(offset[k], half);
        away[k] = point[k] - offset[k];
    }
    for (int k = 0; k < 3; ++k) gradient[k] = dot3(a->metric[k], away);
    for (int n = 0; n < 6; ++n) {
        const int k = n % 3;
        const float moved = clamped(point[k] - gradient[k] / fmaxf(a->metric[k][k], FLT_MIN), half);
        const float step = moved - point[k];
        point[k] = moved;
        for (int j = 0; j < 3; ++j) gradient[j] = gradient[j] + a->metric[j][k] * step;
    }
    /* From here on as exact as floats are: long ellipsoids have lost digits above. */
    for (int k = 0; k < 3; ++k) away[k] = point[k] - offset[k];
    for (int i = 0; i < 3; ++i) white[i] = dot3(a->whiten[i], away);
    for (int j = 0; j < 3; ++j)
        across[j] = a->whiten[0][j] * white[0] + a->whiten[1][j] * white[1] + a->whiten[2][j] * white[2];
    const float gap = -dot3(across, offset) - half * (fabsf(across[0]) + fabsf(across[1]) + fabsf(across[2]));
    return !(gap > a->reach * sqrtf(dot3(white, white)));
}

void gsgi__body_count_sheet(const gsgi__body* a, const float offset[3], float half, gsgi__sheets* node) {
    float far = 0.0f;
    for (int k = 0; k < 3; ++k) {
        const float along = fabsf(dot3(offset, a->axes[k]));
        const float width = half * (fabsf(a->axes[k][0]) + fabsf(a->axes[k][1]) + fabsf(a->axes[k][2]));
        if (k == 0) {
            if (!(along <= width)) return;
            continue;
        }
        const float beyond = fmaxf(along - width / 2.0f, 0.0f) / a->deviation[k];
        far = far + beyond * beyond;
    }
    ++node->through;
    if (!(far <= (float)(SHEET * SHEET))) return;
    /* Where points lie on a sheet, as many more Gaussians than reach a point are listed as the cell's edge is longer
     * than their mean in-plane radius. */
    const float mean = a->reach / a->deviation[0] * 2.0f / (1.0f / a->deviation[1] + 1.0f / a->deviation[2]);
    ++node->crossing;
    node->wish += (double)(1.0f / mean);
}
