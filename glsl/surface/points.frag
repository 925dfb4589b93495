// Selects the surface points at which the Gaussians are read: each pixel of the target takes one of the SPLAT_SCALE x
// SPLAT_SCALE pixels that it covers in the host's textures.
#include "lib/camera.glsl"
#include "surface/host.glsl"
#include "surface/sector.glsl"

uniform highp sampler2D normal;
uniform highp sampler2D depth;
#if RELIEF
uniform highp sampler2D mapped;  // the normals as normal maps bend them, encoded as `normal`
#endif

uniform mat4 world_from_view;
uniform mat4 world_from_offset;
uniform vec2 axis;
uniform vec2 size;      // px, of the view
uniform vec2 corner;    // px; origin of the view in the textures
uniform vec2 depth_ends;
uniform vec2 depth_line;
uniform vec2 z_to_clip;
uniform bool parallel;
#if BOX
uniform vec3 box_low;
uniform vec3 box_high;
#endif

#if SECTORS
uniform highp sampler2D sectors;  // a row for each: lowest corner and weight, highest corner and class
uniform int sector_count;
uniform int sector_class;  // of those that are read now
uniform float sector_margin;  // m
#endif

// World space, m; with SECTORS the weight of the one that is read, else 1. It is negative unless the block is even.
layout(location = 0) out vec4 out_position;
// Tangent plane: unit normal n, world space; -n . position. (0, 0, 0, 1) if nothing tells the normal; 0: no surface.
layout(location = 1) out vec4 out_plane;
#if RELIEF
layout(location = 2) out vec4 out_bend;      // mapped minus interpolated normal, world space
#endif

float depth_at(ivec2 texel) {
    float stored = texelFetch(depth, ivec2(corner) + texel, 0).r;
    return depth_from_texel(stored, DepthCode(depth_ends, depth_line, z_to_clip, parallel));
}

#if SPLAT_SCALE == 1
ivec2 chosen_texel(ivec2 target, out bool even) {
    even = true;
    return target;
}
#else
// Step of depth, relative to the distance, above which pixels show different surfaces.
#define DEPTH_STEP 0.1
// In an even block all pixels show a surface, and none is further from the middle's tangent plane than this, relative
// to the distance from the eye: less than a pixel is wide.
#define EVEN 0.001

// The middle of the block or, if the block shows several surfaces, the nearest and the farthest alternately in a
// checkerboard pattern, so that any three neighbours contain both. Surfaces take precedence over the background.
// `even`: whether the block shows one even surface.
ivec2 chosen_texel(ivec2 target, out bool even) {
    ivec2 last = ivec2(size) - 1;
    ivec2 middle = min(target * SPLAT_SCALE + SPLAT_SCALE / 2, last), near_texel = middle, far_texel = middle;
    float seen = depth_at(middle), nearest = seen, farthest = seen;
    vec3 n = normal_from_texel(texelFetch(normal, ivec2(corner) + middle, 0), world_from_view);
    vec3 x = world_from_fragment(vec2(middle) + 0.5, seen, axis, world_from_offset, parallel);
    vec4 plane = vec4(n, -dot(n, x)) * world_from_offset;
    float tolerance = EVEN * viewing_distance(seen, size.y, world_from_offset, parallel);
    even = true;
    for (int i = 0; i < SPLAT_SCALE * SPLAT_SCALE; ++i) {
        ivec2 texel = min(target * SPLAT_SCALE + ivec2(i % SPLAT_SCALE, i / SPLAT_SCALE), last);
        float d = depth_at(texel);
        float off = abs(dot(plane, offset_from_fragment(vec2(texel) + 0.5, d, axis, parallel)));
        even = even && d > 0.0 && off < tolerance;  // NaN fails the test
        if (d > 0.0 && (d < nearest || nearest <= 0.0)) {
            nearest = d;
            near_texel = texel;
        }
        if (d > farthest) {
            farthest = d;
            far_texel = texel;
        }
    }
    float same = DEPTH_STEP * viewing_distance(nearest, size.y, world_from_offset, parallel);
    if (seen > 0.0 && farthest < nearest + same) return middle;
    return ((target.x + target.y) & 1) == 0 ? near_texel : far_texel;
}
#endif

void main() {
    bool even;
    ivec2 texel = chosen_texel(ivec2(gl_FragCoord.xy), even);
    float view_depth = depth_at(texel);
    out_position = vec4(world_from_fragment(vec2(texel) + 0.5, view_depth, axis, world_from_offset, parallel), 1.0);
    bool seen = view_depth > 0.0;
#if SECTORS
    float own = 0.0, total = 0.0;
    for (int i = 0; i < sector_count; ++i) {
        vec4 low = texelFetch(sectors, ivec2(0, i), 0), high = texelFetch(sectors, ivec2(1, i), 0);
        float weight = low.w * sector_window(out_position.xyz, low.xyz, high.xyz, sector_margin);
        total += weight;
        own += int(high.w) == sector_class ? weight : 0.0;
    }
    out_position.w = own / max(total, 1.0);  // around a box that is left out windows add up to more than 1
    seen = seen && own > 0.0;
#endif
#if BOX
    seen = seen && all(greaterThanEqual(out_position.xyz, box_low)) && all(lessThanEqual(out_position.xyz, box_high));
#endif
    vec3 n = normal_from_texel(texelFetch(normal, ivec2(corner) + texel, 0), world_from_view);
#if RELIEF
    vec3 m = normal_from_texel(texelFetch(mapped, ivec2(corner) + texel, 0), world_from_view);
    out_bend = vec4(dot(m, m) > 0.0 ? m - n : vec3(0.0), 0.0);
#endif
    if (!(seen && even)) out_position.w = -out_position.w;
    vec4 plane = n == vec3(0.0) ? vec4(0.0, 0.0, 0.0, 1.0) : vec4(n, -dot(n, out_position.xyz));
    out_plane = seen ? plane : vec4(0.0);
}
