// Bounds an ellipsoid on the image by a polygon of up to OUTLINE_CORNERS corners, with exact perspective.
#include "lib/camera.glsl"
#include "lib/projection.glsl"

#define OUTLINE_CORNERS  8        // around an ellipse: 1.05 times its area; a rectangle has 1.27 times its area
#define OUTLINE_SMALL    64.0     // px; shorter ellipses get rectangles: more triangles cost more than they save
#define OUTLINE_SLIMMEST 0.05     // of the longer axis; keeps an angle between the sides around a needle
#define OUTLINE_FARTHEST 1e6      // px; float32 cannot place corners further away to a tenth of a pixel

// Half the size of an ellipsoid's bounding box in view space. `axes`: its semi-axes in view space, as columns.
vec3 half_extent(mat3 axes) {
    mat3 rows = transpose(axes);
    return vec3(length(rows[0]), length(rows[1]), length(rows[2]));
}

// An ellipse on the image, in px.
struct Ellipse {
    vec2 middle;
    mat2 axes;  // columns: the semi-axes, longer one first
};

// Image of an ellipsoid in front of the eye's plane. `t`: centre in view space; `extent`: half its size in depth, less
// than the depth of the centre.
Ellipse ellipse_of(vec3 t, mat3 axes, float extent, vec2 focal, vec2 centre) {
    // Sigg et al. 2006, "GPU-Based Ray-Casting of Quadratic Surfaces": the dual conic of the image. Here it is relative
    // to the image of the centre, where it is a sum of squares, which cannot cancel: the ellipse around `offset` with
    // the matrix gram / k + offset offset^T.
    float depth = -t.z;
    float k = (depth - extent) * (depth + extent);
    vec3 along = -transpose(axes)[2];
    vec3 x = vec3(focal.x, 0.0, focal.x * t.x / depth) * axes;
    vec3 y = vec3(0.0, -focal.y, -focal.y * t.y / depth) * axes;
    vec2 offset = -vec2(dot(x, along), dot(y, along)) / k;
    vec3 gram = vec3(dot(x, x), dot(x, y), dot(y, y)) / k;
    vec3 area = cross(x, y) / k, slant = (offset.x * y - offset.y * x) * inversesqrt(k);
    Footprint f = Footprint(gram + offset.xxy * offset.xyy, dot(area, area) + dot(slant, slant));
    return Ellipse(pixel_from_view(t, focal, centre) + offset, ellipse_axes(f));
}

// Furthest extent along `normal`, in px from `centre`, of the part beyond depth `near` of an ellipsoid that crosses it.
float clipped_reach(vec2 normal, vec3 t, mat3 axes, float extent, float near, vec2 focal) {
    // In the plane of depth and s, the coordinate along `normal` times depth, the ellipsoid is an ellipse. The largest
    // s / depth lies where a line through the eye is tangent to it, or on the near plane.
    mat3 rows = transpose(axes);
    vec2 scale = focal * vec2(normal.x, -normal.y);
    float depth = -t.z, s = dot(scale, t.xy);
    vec3 along = -rows[2], across = scale.x * rows[0] + scale.y * rows[1];
    float both = dot(across, along), square = dot(across, across);

    float cut = (near - depth) / extent, slant = both / extent;
    float on_near = s + slant * cut + sqrt(max(square - slant * slant, 0.0) * max(1.0 - cut * cut, 0.0));
    float reach = abs(cut) < 1.0 ? on_near / near : -OUTLINE_FARTHEST;

    // Solve k m^2 - 2 b m + c = 0 for the slopes of the tangents, in the form that does not cancel.
    float k = (depth - extent) * (depth + extent), b = s * depth - both, c = s * s - square;
    float q = b + (b >= 0.0 ? 1.0 : -1.0) * sqrt(max(b * b - k * c, 0.0));
    vec2 slopes = vec2(q / k, c / q);
    for (int i = 0; i < 2; ++i) {
        float m = slopes[i], above = m * depth - s;  // equals length(across - m * along) if the ellipse lies below
        float touched = depth + (both - m * extent * extent) / above;
        if (above > 0.0 && touched >= near) reach = max(reach, m);
    }
    return reach;
}

// Position of `vertex` of a triangle strip, in px. The strip fills a polygon around the part of an ellipsoid beyond the
// depth `near`. `t`: centre in view space; `extent`: half_extent(axes).
vec2 outline_corner(
    int vertex, vec3 t, mat3 axes, vec3 extent, float near, vec2 focal, vec2 centre, vec2 size) {
    Ellipse e = ellipse_of(t, axes, extent.z, focal, centre);
    vec2 half_size = 0.5 * size;
    float longer = length(e.axes[0]);
    // An ellipsoid that reaches the eye's plane has no ellipse; one that nearly reaches it has a huge one.
    bool whole = -t.z - extent.z > near && longer < length(size);
    bool placed = dot(abs(focal), abs(t.xy) + extent.xy) < near * OUTLINE_FARTHEST;

    int corners = whole && longer < OUTLINE_SMALL ? 4 : OUTLINE_CORNERS, last = min(vertex, corners - 1);
    int corner = (last & 1) == 1 ? (last + 1) / 2 : (corners - last / 2) % corners;

    vec2 middle = whole ? e.middle : placed ? centre : half_size;
    vec2 normals[2];
    float reaches[2];
    for (int i = 0; i < 2; ++i) {
        float angle = 2.0 * PI / float(corners) * float((corner + i) % corners);
        vec2 normal = vec2(cos(angle), sin(angle));
        if (whole) {
            mat2 turned = mat2(e.axes[0] / longer, vec2(-e.axes[0].y, e.axes[0].x) / longer);
            float slimness = max(length(e.axes[1]) / longer, OUTLINE_SLIMMEST);
            normal = turned * normalize(vec2(slimness * normal.x, normal.y));
        }
        normals[i] = normal;
        reaches[i] = whole ? length(normal * e.axes)
                   : placed ? clipped_reach(normal, t, axes, extent.z, near, focal)
                            : dot(abs(normal), half_size);
    }
    // Intersect the two sides.
    vec2 across = reaches[0] * normals[1].yx - reaches[1] * normals[0].yx;
    return middle + vec2(across.x, -across.y) / (normals[0].x * normals[1].y - normals[0].y * normals[1].x);
}
