// B from a light propagation volume (Kaplanyan and Dachsbacher 2010, "Cascaded Light Propagation Volumes for Real-Time
// Indirect Illumination"): spherical harmonics of degree 1 over the directions in which light travels.
#define SH_DEGREE 1
#include "lib/camera.glsl"
#include "lib/octahedral.glsl"
#include "lib/sh.glsl"

uniform highp sampler2D depth;
uniform highp sampler2D normal;
uniform highp sampler3D red;  // the four coefficients of each channel
uniform highp sampler3D green;
uniform highp sampler3D blue;
uniform mat4 world_from_offset;
uniform vec2 axis;
uniform vec3 corner;  // of the cells, m
uniform float edge;   // of a cell, m
uniform vec3 size;    // cells along each axis

layout(location = 0) out vec4 out_indirect;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float away = texelFetch(depth, texel, 0).x;
    vec3 n = normal_from_octahedral(texelFetch(normal, texel, 0).xy);
    vec3 x = world_from_fragment(gl_FragCoord.xy, away, axis, world_from_offset);
    vec3 at = ((x + 0.5 * edge * n - corner) / edge) / size;
    float basis[SH_COUNT];
    sh_basis(-n, basis);
    vec4 towards = vec4(basis[0], basis[1], basis[2], basis[3]);
    vec3 light = vec3(dot(texture(red, at), towards), dot(texture(green, at), towards), dot(texture(blue, at), towards));
    out_indirect = vec4(away > 0.0 ? max(light, 0.0) : vec3(0.0), 1.0);
}
