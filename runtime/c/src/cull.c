/* What a camera may see; Gaussians of the `over` operator, and in which order. */
#include "internal.h"
#include "lib/constants.glsl"

#include <math.h>
#include <string.h>

#define DIGIT_BITS 11 /* three rounds of the radix sort; a histogram fits in the L1 cache */
#define DIGITS (1u << DIGIT_BITS)

bool gsgi__culled_create(gsgi__culled* culled, const gsgi_callbacks* callbacks, const gsgi__level* level,
                         const gsgi_info* info) {
    const size_t count = level->count, words = 8;
    culled->count = level->count;
    culled->visible = 0;
    if (count == 0) return true;
    if (count > SIZE_MAX / (words * sizeof(float))) return false;
    if (!(culled->x = gsgi__allocate(callbacks, words * count * sizeof(float)))) return false;
    culled->y = culled->x + count;
    culled->z = culled->y + count;
    culled->radius = culled->z + count;
    culled->index = (uint32_t*)(culled->radius + count);
    culled->keys = culled->index + count;
    culled->sorted_index = culled->keys + count;
    culled->sorted_keys = culled->sorted_index + count;
    for (size_t i = 0; i < count; ++i) {
        const float *shape = level->shape.texels + i * GSGI_SHAPE_FLOATS, *scale = shape + 8;
        /* opacity * exp(-r^2 / 2) falls to alpha_min at r standard deviations */
        const float reach = sqrtf(2.0f * logf(fmaxf(shape[3] / info->alpha_min, 1.0f)));
        culled->x[i] = shape[0];
        culled->y[i] = shape[1];
        culled->z[i] = shape[2];
        culled->radius[i] = reach * fmaxf(scale[0], fmaxf(scale[1], scale[2]));
    }
    return true;
}

void gsgi__culled_destroy(gsgi__culled* culled, const gsgi_callbacks* callbacks) {
    gsgi__release(callbacks, culled->x);
}

bool gsgi__in_view(const gsgi__camera* camera, const float ball[4]) {
    /* Slopes, x and y over depth, of the image's edges; with parallel rays x and y themselves. A negative focal length
     * mirrors the image. */
    const double a = -camera->cx / camera->fx, b = (camera->width - camera->cx) / camera->fx;
    const double c = (camera->cy - camera->height) / camera->fy, d = camera->cy / camera->fy;
    const double edges[4] = {fmin(a, b), -fmax(a, b), fmin(c, d), -fmax(c, d)};
    double inward[5][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, -1}};
    for (int p = 0; p < 4 && !camera->parallel; ++p) inward[p][2] = edges[p];
    for (int p = 0; p < 5; ++p) {
        float plane[4];
        const double length =
            sqrt(inward[p][0] * inward[p][0] + inward[p][1] * inward[p][1] + inward[p][2] * inward[p][2]);
        for (int k = 0; k < 4; ++k) {
            double sum = 0.0;
            for (int j = 0; j < 3; ++j) sum += inward[p][j] / length * camera->view_from_world.at[j][k];
            plane[k] = (float)(camera->parallel && p < 4 && k == 3 ? sum - edges[p] : sum);
        }
        if (!(plane[0] * ball[0] + plane[1] * ball[1] + plane[2] * ball[2] + plane[3] >= -ball[3])) return false;
    }
    return true;
}

/* Sort `index` by rising key; equal keys keep their order. Radix sort, from the lowest digit on. */
static void sort_by_key(gsgi__culled* culled) {
    for (int shift = 0; shift < 32; shift += DIGIT_BITS) {
        uint32_t begin[DIGITS] = {0}, sum = 0;
        for (uint32_t i = 0; i < culled->visible; ++i) ++begin[culled->keys[i] >> shift & (DIGITS - 1)];
        for (uint32_t digit = 0; digit < DIGITS; ++digit) {
            uint32_t length = begin[digit];
            begin[digit] = sum;
            sum += length;
        }
        for (uint32_t i = 0; i < culled->visible; ++i) {
            uint32_t to = begin[culled->keys[i] >> shift & (DIGITS - 1)]++;
            culled->sorted_keys[to] = culled->keys[i];
            culled->sorted_index[to] = culled->index[i];
        }
        uint32_t *keys = culled->keys, *index = culled->index;
        culled->keys = culled->sorted_keys;
        culled->index = culled->sorted_index;
        culled->sorted_keys = keys;
        culled->sorted_index = index;
    }
}

/* Bound, in px, on the size of a splat: the spectral norm of the projection's Jacobian times its radius. */
static bool overlaps_image(float x, float y, float depth, float radius, const gsgi__camera* camera, float limit_x,
                           float limit_y, float widest) {
    const float slope_x = fminf(fmaxf(x, -limit_x), limit_x), slope_y = fminf(fmaxf(y, -limit_y), limit_y);
    const float focal = (float)fmax(fabs(camera->fx), fabs(camera->fy));
    const float reach = radius * focal / depth * sqrtf(1.0f + slope_x * slope_x + slope_y * slope_y) + widest;
    const float column = (float)camera->cx + (float)camera->fx * x, row = (float)camera->cy - (float)camera->fy * y;
    return column + reach >= 0.0f && column - reach <= (float)camera->width && row + reach >= 0.0f &&
           row - reach <= (float)camera->height;
}

void gsgi__cull_and_sort(gsgi__culled* culled, const gsgi__camera* camera, const gsgi_info* info) {
    const float limit_x = (float)(FRUSTUM_CLAMP * camera->width / fabs(2.0 * camera->fx));
    const float limit_y = (float)(FRUSTUM_CLAMP * camera->height / fabs(2.0 * camera->fy));
    /* How far dilation widens an opaque splat, px. */
    const float widest = sqrtf(2.0f * logf(1.0f / info->alpha_min) * info->dilation);
    float rows[3][4];
    for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 4; ++k) rows[j][k] = (float)camera->view_from_world.at[j][k];
    culled->visible = 0;
    /* Backwards, so that after the sort the earlier one of equal depths is in front. */
    for (uint32_t i = culled->count; i-- > 0;) {
        const float x = culled->x[i], y = culled->y[i], z = culled->z[i];
        const float right = rows[0][0] * x + rows[0][1] * y + rows[0][2] * z + rows[0][3];
        const float up = rows[1][0] * x + rows[1][1] * y + rows[1][2] * z + rows[1][3];
        const float depth = -(rows[2][0] * x + rows[2][1] * y + rows[2][2] * z + rows[2][3]);
        if (!(depth >= info->near_plane) ||
            !overlaps_image(right / depth, up / depth, depth, culled->radius[i], camera, limit_x, limit_y, widest))
            continue;
        uint32_t bits;
        memcpy(&bits, &depth, sizeof bits); /* floats >= 0 sort as their bits do */
        culled->index[culled->visible] = i;
        culled->keys[culled->visible++] = depth > 0.0f ? ~bits : ~0u; /* -0 is 0; farthest first */
    }
    sort_by_key(culled);
}
