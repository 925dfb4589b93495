/* A host's matrices as the camera that the passes need. All arithmetic is that of runtime/gl/view.py. */
#include "internal.h"

#include <math.h>

static gsgi__matrix inverse_of_rigid(const gsgi__matrix* m) {
    gsgi__matrix inverse = {{{0.0}}};
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) inverse.at[i][k] = m->at[k][i];
        inverse.at[i][3] = -m->at[0][i] * m->at[0][3] - m->at[1][i] * m->at[1][3] - m->at[2][i] * m->at[2][3];
    }
    inverse.at[3][3] = 1.0;
    return inverse;
}

/* Far from the origin the translation is rounded more than the rotation, so only that is looked at. */
static bool is_rigid(const gsgi__matrix* m) {
    for (int i = 0; i < 3; ++i) {
        if (!isfinite(m->at[i][3]) || m->at[3][i] != 0.0) return false;
        for (int k = 0; k < 3; ++k) {
            const double dot = m->at[i][0] * m->at[k][0] + m->at[i][1] * m->at[k][1] + m->at[i][2] * m->at[k][2];
            if (!(fabs(dot - (i == k)) <= 1e-4)) return false;
        }
    }
    return m->at[3][3] == 1.0;
}

static double determinant(const gsgi__matrix* m) {
    const double *x = m->at[0], *y = m->at[1], *z = m->at[2];
    return x[0] * (y[1] * z[2] - y[2] * z[1]) - x[1] * (y[0] * z[2] - y[2] * z[0]) + x[2] * (y[0] * z[1] - y[1] * z[0]);
}

/* Whether only those elements differ from 0 that vary in a projection; `last`: that of the last row. */
static bool is_projection(const gsgi__matrix* p, const bool varies[4][4], double last) {
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 4; ++k)
            if (!isfinite(p->at[i][k]) || (!varies[i][k] && fabs(p->at[i][k]) > 1e-8)) return false;
    return fabs(last - 1.0) <= 1e-5 && p->at[0][0] * p->at[1][1] != 0.0;
}

static bool is_perspective(const gsgi__matrix* p) {
    static const bool varies[4][4] = {{1, 0, 1, 0}, {0, 1, 1, 0}, {0, 0, 1, 1}, {0, 0, 1, 0}};
    return is_projection(p, varies, fabs(p->at[3][2]));
}

static bool is_orthographic(const gsgi__matrix* p) {
    static const bool varies[4][4] = {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 1, 1}, {0, 0, 0, 1}};
    return is_projection(p, varies, p->at[3][3]) && p->at[2][2] != 0.0;
}

static gsgi__matrix matrix_of(const float columns[16]) {
    gsgi__matrix m;
    for (int i = 0; i < 16; ++i) m.at[i % 4][i / 4] = columns[i];
    return m;
}

/* Refuse a projection that cannot have drawn a depth buffer of this encoding. */
static gsgi_result check_depth(double z, double one, gsgi_depth depth, const gsgi_callbacks* callbacks) {
    if ((depth == GSGI_DEPTH_WINDOW || depth == GSGI_DEPTH_ZERO_TO_ONE) && one > 0.0)
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "clip_from_view: near has the largest z, which needs GSGI_DEPTH_REVERSED");
    if (depth == GSGI_DEPTH_REVERSED && one < 0.0)
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "clip_from_view: near has the smallest z, but depth is GSGI_DEPTH_REVERSED");
    if (depth == GSGI_DEPTH_REVERSED && z > 1.0)
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "clip_from_view: GSGI_DEPTH_REVERSED needs 0 <= z <= w and a far plane beyond twice the near "
                          "plane; this projection has -w <= z <= w");
    return GSGI_OK;
}

/* Turn the view space so that it looks down -z and is right-handed: rows of the pose, columns of the projection. */
static void turn(gsgi__matrix* pose, gsgi__matrix* p, double ahead) {
    const double up = determinant(pose) * ahead < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 4; ++i) {
        pose->at[1][i] *= up;
        p->at[i][1] *= up;
        pose->at[2][i] *= ahead;
        p->at[i][2] *= ahead;
    }
}

/* How depth is encoded; `shift`: m, by which the eye stands behind the host's. */
static void set_depth_code(const gsgi_light_options* options, double z, double one, double shift,
                           gsgi__camera* camera) {
    const double first = options->depth_range[0], last = options->depth_range[1];
    const double lowest = options->depth == GSGI_DEPTH_WINDOW ? -1.0 : 0.0, scale = (1.0 - lowest) / (last - first);
    const bool linear = options->depth == GSGI_DEPTH_LINEAR, reversed = options->depth == GSGI_DEPTH_REVERSED;
    camera->depth_ends[0] = linear ? 0.0f : (float)(reversed ? last : first);
    camera->depth_ends[1] = linear ? 0.0f : (float)(reversed ? first : last);
    camera->depth_line[0] = linear ? 1.0f : (float)scale;
    camera->depth_line[1] = (float)(linear ? shift : lowest - first * scale);
    camera->z_to_clip[0] = (float)z;
    camera->z_to_clip[1] = (float)one;
}

gsgi_result gsgi__camera_of_view(const gsgi_view* view, const gsgi_light_options* options, const double origin[3],
                                 const gsgi_callbacks* callbacks, gsgi__camera* camera) {
    gsgi__matrix given = matrix_of(view->view_from_world), p = matrix_of(view->clip_from_view);
    const int32_t* viewport = view->viewport;
    const bool parallel = camera->parallel = is_orthographic(&p);
    if (!is_rigid(&given))
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "view_from_world: a rigid matrix is needed, without scale or shear");
    if (!parallel && !is_perspective(&p))
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "clip_from_view: a projection is needed, perspective or orthographic");
    if (viewport[0] < 0 || viewport[1] < 0 || viewport[2] < 1 || viewport[3] < 1)
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "viewport: %d, %d, %d, %d is not x, y, width, height",
                          viewport[0], viewport[1], viewport[2], viewport[3]);
    camera->world_from_host = inverse_of_rigid(&given);
    const bool backward = options->depth == GSGI_DEPTH_REVERSED;
    turn(&given, &p, parallel ? ((p.at[2][2] < 0.0) != backward ? 1.0 : -1.0) : -p.at[3][2]);

    const double z = p.at[2][2];
    double one = p.at[2][3], shift = 0.0;
    camera->world_from_view = inverse_of_rigid(&given);
    double near_plane = parallel ? (one + copysign(1.0, -z)) / z : one / (z + copysign(1.0, one));
    if (parallel) {
        /* The eye lies so far back that all depths are positive. */
        shift = 2.0 / fabs(z) - near_plane;
        near_plane = 2.0 / fabs(z);
        one += shift * z;
        for (int i = 0; i < 3; ++i) camera->world_from_view.at[i][3] += shift * camera->world_from_view.at[i][2];
    }
    if (!(isfinite(near_plane) && near_plane > 0.0))
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "clip_from_view: a near plane in front of the eye is needed");
    if (!parallel) {
        gsgi_result result = check_depth(z, one, options->depth, callbacks);
        if (result) return result;
    }
    set_depth_code(options, z, one, shift, camera);

    for (int i = 0; i < 3; ++i) camera->world_from_view.at[i][3] -= origin[i];
    camera->view_from_world = inverse_of_rigid(&camera->world_from_view);

    const double mirror = options->rows == GSGI_ROWS_TOP_DOWN ? -1.0 : 1.0, width = viewport[2], height = viewport[3];
    const double x = parallel ? p.at[0][3] : -p.at[0][2], y = mirror * (parallel ? p.at[1][3] : -p.at[1][2]);
    camera->fx = p.at[0][0] * width / 2.0;
    camera->fy = mirror * p.at[1][1] * height / 2.0;
    camera->cx = (1.0 + x) * width / 2.0;
    camera->cy = (1.0 - y) * height / 2.0;
    camera->x = viewport[0];
    camera->y = viewport[1];
    camera->width = viewport[2];
    camera->height = viewport[3];
    return GSGI_OK;
}
