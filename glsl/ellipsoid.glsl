// Where an ellipsoid appears on the image: exact, in perspective.
#include "camera.glsl"
#include "projection.glsl"

// A rectangle on the image, in px.
struct Bounds {
    vec2 middle;
    mat2 axes;  // columns: from the middle to two neighbouring edges
};

// Half the size of an ellipsoid's box in view space; `axes`: its semi-axes there, as columns.
vec3 half_extent(mat3 axes) {
    mat3 rows = transpose(axes);
    return vec3(length(rows[0]), length(rows[1]), length(rows[2]));
}

// The rectangle around the ellipse that an ellipsoid in front of the eye's plane appears as, along the ellipse's axes.
// `t`: centre in view space; `extent` in depth, less than the centre's.
Bounds ellipse_bounds(vec3 t, mat3 axes, float extent, vec2 focal, vec2 centre) {
    // Sigg et al. 2006, "GPU-Based Ray-Casting of Quadratic Surfaces": the dual conic of the image, here relative to
    // the image of the centre, where it is a sum of squares that cannot cancel: the ellipse around `offset` with the
    // matrix gram / k + offset offset^T.
    float depth = -t.z;
    float k = (depth - extent) * (depth + extent);
    vec3 along = -transpose(axes)[2];
    vec3 x = vec3(focal.x, 0.0, focal.x * t.x / depth) * axes;
    vec3 y = vec3(0.0, -focal.y, -focal.y * t.y / depth) * axes;
    vec2 offset = -vec2(dot(x, along), dot(y, along)) / k;
    vec3 gram = vec3(dot(x, x), dot(x, y), dot(y, y)) / k;
    vec3 area = cross(x, y) / k, slant = (offset.x * y - offset.y * x) * inversesqrt(k);
    Footprint f = Footprint(gram + offset.xxy * offset.xyy, dot(area, area) + dot(slant, slant));
    return Bounds(pixel_from_view(t, focal, centre) + offset, ellipse_axes(f));
}

// A rectangle along the image's edges, inside the image, around what lies beyond the depth `nearest` of an ellipsoid's
// box in view space. Where there is nothing it has no area in the image.
Bounds box_bounds(vec3 t, vec3 extent, float nearest, vec2 focal, vec2 centre, vec2 size) {
    float farthest = extent.z - t.z;
    vec2 low = vec2(t.x, -t.y) - extent.xy, high = vec2(t.x, -t.y) + extent.xy;
    low /= mix(vec2(farthest), vec2(nearest), lessThan(low, vec2(0.0)));
    high /= mix(vec2(nearest), vec2(farthest), lessThan(high, vec2(0.0)));
    low = max(centre + focal * low, vec2(0.0));
    high = min(centre + focal * high, size);
    vec2 half_size = 0.5 * (high - low);
    return Bounds(low + half_size, mat2(half_size.x, 0.0, 0.0, half_size.y));
}

// The rectangle around what of an ellipsoid lies beyond the depth `near`. `extent`: half_extent(axes).
Bounds image_bounds(vec3 t, mat3 axes, vec3 extent, float near, vec2 focal, vec2 centre, vec2 size) {
    Bounds b = ellipse_bounds(t, axes, extent.z, focal, centre);
    // One that reaches the eye's plane has no ellipse, one that nearly does a vast one.
    if (!(-t.z - extent.z > near && dot(b.axes[0], b.axes[0]) < dot(size, size)))
        b = box_bounds(t, extent, max(near, -t.z - extent.z), focal, centre, size);
    return b;
}
