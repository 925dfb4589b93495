// B by voxel cone tracing (Crassin et al. 2011, "Interactive Indirect Illumination Using Voxel Cone Tracing"): six cones
// through voxels that hold radiance and opacity as they are seen along each axis.
#define SH_DEGREE 2
#include "lib/camera.glsl"
#include "lib/octahedral.glsl"
#include "lib/sh.glsl"

uniform highp sampler2D depth;
uniform highp sampler2D normal;
// Radiance times opacity, and opacity, as seen along +x, -x, +y, -y, +z and -z. Level 0 begins at the origin, level 1
// beside it along x, and the others above that along y; all have a border of one texel of 0.
uniform highp sampler3D side0;
uniform highp sampler3D side1;
uniform highp sampler3D side2;
uniform highp sampler3D side3;
uniform highp sampler3D side4;
uniform highp sampler3D side5;
uniform mat4 world_from_offset;
uniform vec2 axis;
uniform vec3 corner;           // of the voxels, m
uniform float edge;            // of the finest, m
uniform vec3 size;             // the finest along each axis
uniform float levels;
uniform vec3 surroundings[9];  // radiance of the environment in a cone, by its direction

layout(location = 0) out vec4 out_indirect;

#define STEPS 3.0     // per level
#define START 1.0     // finest voxels, along the normal
#define REACH 0.8660254  // distance at which a cone of 60 degrees is one wide
#define PASSING_MIN 0.004  // of a cone's light: less is not followed
#define TILTED 5
#define ALONG_NORMAL 0.25
#define TILTED_WEIGHT 0.15

vec4 seen_along(vec3 d, vec3 at) {
    vec4 x = d.x > 0.0 ? texture(side0, at) : texture(side1, at);
    vec4 y = d.y > 0.0 ? texture(side2, at) : texture(side3, at);
    vec4 z = d.z > 0.0 ? texture(side4, at) : texture(side5, at);
    return abs(d.x) * x + abs(d.y) * y + abs(d.z) * z;
}

// Radiance that arrives in a cone from `start`, in the finest voxels, along the unit direction `d`.
vec3 cone(vec3 start, vec3 d) {
    vec3 light = vec3(0.0), texels = vec3(textureSize(side0, 0)), count = size, first = vec3(1.0);
    float passing = 1.0;
    for (float level = 0.0; level < levels; level += 1.0) {
        for (float i = 0.0; i < STEPS; i += 1.0) {
            vec3 at = (start + REACH * exp2(level + i / STEPS) * d) / exp2(level);
            vec4 seen = seen_along(d, (first + clamp(at, vec3(-0.5), count + 0.5)) / texels);
            seen /= max(seen.w, 1.0);
            light += passing * seen.xyz;
            passing *= 1.0 - seen.w;
            if (passing < PASSING_MIN) return light;
        }
        first += level == 0.0 ? vec3(count.x + 2.0, 0.0, 0.0) : vec3(0.0, count.y + 2.0, 0.0);
        count = ceil(0.5 * count);
    }
    return light + passing * max(sh_sum(surroundings, d), 0.0);
}

vec3 light_at(vec3 x, vec3 n) {
    vec3 start = (x - corner) / edge + START * n;
    vec3 tangent = normalize(cross(abs(n.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0), n));
    vec3 bitangent = cross(n, tangent);
    vec3 light = ALONG_NORMAL * cone(start, n);
    for (int i = 0; i < TILTED; ++i) {
        float angle = 2.0 * PI * float(i) / float(TILTED);
        vec3 d = 0.5 * n + REACH * (cos(angle) * tangent + sin(angle) * bitangent);
        light += TILTED_WEIGHT * cone(start, d);
    }
    return light;
}

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float away = texelFetch(depth, texel, 0).x;
    vec3 n = normal_from_octahedral(texelFetch(normal, texel, 0).xy);
    vec3 x = world_from_fragment(gl_FragCoord.xy, away, axis, world_from_offset);
    out_indirect = vec4(away > 0.0 ? light_at(x, n) : vec3(0.0), 1.0);
}
