// B from a grid of probes that hold spherical harmonics of the normal (Greger et al. 1998; Ramamoorthi and Hanrahan 2001).
// With VISIBILITY, probes that a surface hides are left out by the test of Majercik et al. 2019, "Dynamic Diffuse Global
// Illumination with Ray-Traced Irradiance Fields".
#define SH_DEGREE 2
#include "lib/camera.glsl"
#include "lib/octahedral.glsl"
#include "lib/sh.glsl"

uniform highp sampler2D depth;
uniform highp sampler2D normal;
uniform highp sampler3D sh0;  // the 27 coefficients in order, RGB innermost, four to a texture
uniform highp sampler3D sh1;
uniform highp sampler3D sh2;
uniform highp sampler3D sh3;
uniform highp sampler3D sh4;
uniform highp sampler3D sh5;
uniform highp sampler3D sh6;
uniform mat4 world_from_offset;
uniform vec2 axis;
uniform vec3 first;    // of the probes, m
uniform vec3 spacing;  // between probes, m
uniform vec3 count;    // probes along each axis
uniform float bias;    // m, along the normal

layout(location = 0) out vec4 out_indirect;

vec3 light_of(vec4 a, vec4 b, vec4 c, vec4 d, vec4 e, vec4 f, vec4 g, vec3 n) {
    vec3 sh[SH_COUNT] = vec3[](a.xyz, vec3(a.w, b.xy), vec3(b.zw, c.x), c.yzw, d.xyz, vec3(d.w, e.xy), vec3(e.zw, f.x),
                               f.yzw, g.xyz);
    return sh_sum(sh, n);
}

#if VISIBILITY
uniform highp sampler2D moments;  // mean distance and mean squared distance, m, in octahedral tiles with a border
uniform float tile;               // texels along an edge, without the border of one
uniform float tiles;              // in a row

#define FACING_MIN     0.2   // weight of a probe behind the surface, as in the paper
#define WEIGHT_MIN     0.05  // of a hidden probe, so that a point that sees no probe has some light
#define WEIGHT_CRUSHED 0.2   // smaller weights fall faster

vec3 light_at(vec3 x, vec3 n) {
    vec3 at = clamp((x + bias * n - first) / spacing, vec3(0.0), count - 1.0);
    vec3 base = min(floor(at), max(count - 2.0, vec3(0.0))), share = at - base;
    vec4 sums = vec4(0.0);
    for (int i = 0; i < 8; ++i) {
        vec3 corner = vec3(i & 1, (i >> 1) & 1, i >> 2);
        vec3 probe = min(base + corner, count - 1.0);
        vec3 linear = mix(1.0 - share, share, corner);
        vec3 position = first + spacing * probe;
        float facing = 0.5 * dot(normalize(position - x), n) + 0.5;
        vec3 way = x + bias * n - position;
        float reach = length(way), index = probe.x + count.x * (probe.y + count.y * probe.z);
        vec2 corner_of_tile = (tile + 2.0) * vec2(mod(index, tiles), floor(index / tiles)) + 1.0;
        vec2 inside = tile * (0.5 * octahedral_from_normal(way / max(reach, 1e-6)) + 0.5);
        vec2 found = texture(moments, (corner_of_tile + inside) / vec2(textureSize(moments, 0))).xy;
        float variance = abs(found.y - found.x * found.x), beyond = max(reach - found.x, 0.0);
        float visible = variance / max(variance + beyond * beyond, 1e-12);
        visible = beyond > 0.0 ? max(visible * visible * visible, WEIGHT_MIN) : 1.0;
        float weight = visible * (facing * facing + FACING_MIN);
        if (weight < WEIGHT_CRUSHED) weight *= weight * weight / (WEIGHT_CRUSHED * WEIGHT_CRUSHED);
        weight *= linear.x * linear.y * linear.z;
        ivec3 p = ivec3(probe);
        vec3 light = light_of(texelFetch(sh0, p, 0), texelFetch(sh1, p, 0), texelFetch(sh2, p, 0), texelFetch(sh3, p, 0),
                              texelFetch(sh4, p, 0), texelFetch(sh5, p, 0), texelFetch(sh6, p, 0), n);
        sums += weight * vec4(light, 1.0);
    }
    return max(sums.xyz / max(sums.w, 1e-12), 0.0);
}
#else
vec3 light_at(vec3 x, vec3 n) {
    vec3 at = ((x + bias * n - first) / spacing + 0.5) / count;
    vec3 light = light_of(texture(sh0, at), texture(sh1, at), texture(sh2, at), texture(sh3, at), texture(sh4, at),
                          texture(sh5, at), texture(sh6, at), n);
    return max(light, 0.0);
}
#endif

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float away = texelFetch(depth, texel, 0).x;
    vec3 n = normal_from_octahedral(texelFetch(normal, texel, 0).xy);
    vec3 x = world_from_fragment(gl_FragCoord.xy, away, axis, world_from_offset);
    out_indirect = vec4(away > 0.0 ? light_at(x, n) : vec3(0.0), 1.0);
}
