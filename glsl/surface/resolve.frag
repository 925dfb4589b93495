// Upsamples: adds the sums of the nearest points, each weighted by how well its surface matches the pixel's, and computes B
// by one division.
#include "lib/camera.glsl"
#include "lib/constants.glsl"
#include "surface/host.glsl"
#include "surface/taps.glsl"

uniform highp sampler2D filled_sums;
uniform highp sampler2D surface_plane;
uniform highp sampler2D normal;
uniform highp sampler2D depth;

uniform mat4 world_from_view;
uniform mat4 world_from_offset;
uniform vec2 axis;
uniform vec2 size;  // px, of the view
uniform vec2 corner;
uniform vec2 depth_ends;
uniform vec2 depth_line;
uniform vec2 z_to_clip;
uniform bool parallel;

layout(location = 0) out vec4 out_indirect;  // B

#define PLANE_TOLERANCE 0.01  // of the distance; a pixel further from a point's plane shows another surface
#define BLUR 0.01             // added to the weights by position, so that no neighbour is left out
#define OTHERS 1e-7           // weight of points of other surfaces, which matter only if there are no others
#define ALIKE_ENOUGH 0.5      // if one of the three nearest points is this alike, those around them are not used

// Similarity, 0 to 1, of a point's tangent plane to that at the pixel's point `x`, normal `n`. `tolerance` in 1/m.
float alike(vec4 plane, vec3 x, vec3 n, float tolerance) {
    float on_plane = max(0.0, 1.0 - tolerance * abs(dot(plane, vec4(x, 1.0))));
    // The normals count with the eighth power of their cosine.
    float cosine = max(0.0, dot(plane.xyz, n)), squared = cosine * cosine, fourth = squared * squared;
    return on_plane * fourth * fourth;
}

vec4 upsampled(ivec2 texel) {
    // Kopf et al. 2007, "Joint Bilateral Upsampling"
    DepthCode code = DepthCode(depth_ends, depth_line, z_to_clip, parallel);
    float view_depth = depth_from_texel(texelFetch(depth, ivec2(corner) + texel, 0).r, code);
    vec3 x = world_from_fragment(gl_FragCoord.xy, view_depth, axis, world_from_offset, parallel);
    vec3 n = normal_from_texel(texelFetch(normal, ivec2(corner) + texel, 0), world_from_view);
    float tolerance = 1.0 / (PLANE_TOLERANCE * viewing_distance(view_depth, size.y, world_from_offset, parallel));

    ivec2 last = textureSize(filled_sums, 0) - 1;
    Taps taps = nearest_taps(texel, SPLAT_SCALE, last);
    float low = alike(texelFetch(surface_plane, taps.low, 0), x, n, tolerance);
    float other = alike(texelFetch(surface_plane, taps.other, 0), x, n, tolerance);
    float high = alike(texelFetch(surface_plane, taps.high, 0), x, n, tolerance);
    vec3 weights = (taps.weights + BLUR) * (vec3(low, other, high) + OTHERS);
    vec4 sum = weights.x * unsigned_sums(texelFetch(filled_sums, taps.low, 0))  // 0 where there is no surface
             + weights.y * unsigned_sums(texelFetch(filled_sums, taps.other, 0))
             + weights.z * unsigned_sums(texelFetch(filled_sums, taps.high, 0));
    // On wires and at outlines, often none of the three points shows the pixel's surface, but one around them does.
    float need = 1.0 - max(low, max(other, high)) / ALIKE_ENOUGH;
    int around = view_depth > 0.0 && need > 0.0 ? 16 : 0;  // llvmpipe exits loops early, but skips no branch
    for (int i = 0; i < around; ++i) {
        ivec2 tap = clamp(taps.square - 1 + ivec2(i % 4, i / 4), ivec2(0), last);
        float weight = need * alike(texelFetch(surface_plane, tap, 0), x, n, tolerance);
        sum += weight * unsigned_sums(texelFetch(filled_sums, tap, 0));
    }
    return view_depth > 0.0 ? sum : vec4(0.0);
}

void main() {
    vec4 sum = upsampled(ivec2(gl_FragCoord.xy));
    vec3 light = sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0);
    out_indirect = vec4(clamp(light, 0.0, HALF_MAX), 1.0);
}
