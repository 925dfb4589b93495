// B from the sums of the `surface` operator, by one division. At lower resolution the filled sums of the four nearest
// points are added up first, each as far as it shows the pixel's surface.
#include "camera.glsl"
#include "constants.glsl"
#include "host.glsl"
#include "surface.glsl"

#if SPLAT_SCALE > 1
uniform highp sampler2D filled_sums;
uniform highp sampler2D surface_plane;
uniform highp sampler2D normal;
uniform highp sampler2D depth;

uniform mat4 world_from_view;
uniform vec2 focal;
uniform vec2 centre;
uniform vec2 size;
uniform vec2 corner;
uniform vec2 z_to_clip;
#else
uniform highp sampler2D fine_sums;
#if COARSE
uniform highp sampler2D coarse_sums;
#endif
uniform float weight_floor;
#endif

layout(location = 0) out vec4 out_indirect;  // B

#if SPLAT_SCALE > 1
#define PLANE_TOLERANCE 0.01  // of depth; a pixel further off a point's plane shows another surface
#define BLUR 0.01             // added to bilinear weights, so that no neighbour is left out
#define OTHERS 1e-7           // of points of other surfaces: taken where there are no others
#define ALIKE_ENOUGH 0.5      // one of the four nearest points as alike as that: no need of those around them

// How far a point's tangent plane is that of the pixel's point x with normal n, 0 to 1. `tolerance`: per m.
float alike(vec4 plane, vec4 x, vec3 n, float tolerance) {
    float on_plane = max(0.0, 1.0 - tolerance * abs(dot(plane, x)));
    // Normals that differ count as the eighth power of their cosine.
    float cosine = max(0.0, dot(plane.xyz, n)), squared = cosine * cosine, fourth = squared * squared;
    return on_plane * fourth * fourth;
}

vec4 upsampled(ivec2 texel) {
    // Kopf et al. 2007, "Joint Bilateral Upsampling"
    float view_depth = depth_from_texel(texelFetch(depth, ivec2(corner) + texel, 0).r, z_to_clip);
    vec2 pixel = pixel_from_fragment(gl_FragCoord.xy, size.y);
    vec4 x = world_from_view * vec4(view_from_pixel(pixel, view_depth, focal, centre), 1.0);
    vec3 n = normal_from_texel(texelFetch(normal, ivec2(corner) + texel, 0), world_from_view);
    float tolerance = 1.0 / (PLANE_TOLERANCE * view_depth);

    vec2 place = vec2(texel - SPLAT_SCALE / 2) / float(SPLAT_SCALE), low = floor(place);
    vec2 part = place - low;
    ivec2 last = textureSize(filled_sums, 0) - 1;
    ivec4 taps = clamp(ivec4(low, low + 1.0), ivec4(0), last.xyxy);
    vec4 bilinear = vec4(1.0 - part.x, part.x, 1.0 - part.x, part.x) * vec4(vec2(1.0 - part.y), vec2(part.y)) + BLUR;
    vec4 sum = vec4(0.0);
    float most_alike = 0.0;
    for (int i = 0; i < 4; ++i) {  // where no surface is, the sums are 0
        ivec2 tap = ivec2((i & 1) == 0 ? taps.x : taps.z, i < 2 ? taps.y : taps.w);
        float weight = alike(texelFetch(surface_plane, tap, 0), x, n, tolerance);
        most_alike = max(most_alike, weight);
        sum += bilinear[i] * (weight + OTHERS) * texelFetch(filled_sums, tap, 0);
    }
    // On wires and at outlines often none of the four, but one of the points around them shows the pixel's surface.
    float need = 1.0 - most_alike / ALIKE_ENOUGH;
    int around = view_depth > 0.0 && need > 0.0 ? 16 : 0;  // llvmpipe leaves loops, but skips no branch
    for (int i = 0; i < around; ++i) {
        ivec2 tap = clamp(ivec2(low) - 1 + ivec2(i % 4, i / 4), ivec2(0), last);
        sum += need * alike(texelFetch(surface_plane, tap, 0), x, n, tolerance) * texelFetch(filled_sums, tap, 0);
    }
    return view_depth > 0.0 ? sum : vec4(0.0);
}
#endif

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
#if SPLAT_SCALE > 1
    vec4 sum = upsampled(texel);
#else
    vec4 fine = texelFetch(fine_sums, texel, 0), coarse = vec4(0.0);
#if COARSE
    if (fine.a < weight_floor) coarse = texelFetch(coarse_sums, texel, 0);
#endif
    vec4 sum = filled(fine, coarse, weight_floor);
#endif
    vec3 light = sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0);
    out_indirect = vec4(clamp(light, 0.0, HALF_MAX), 1.0);
}
