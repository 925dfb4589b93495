// Shades a surface as pyrender does, and adds indirect light.
#include "pyrender/metallic_roughness.glsl"
#include "lib/srgb.glsl"
#include "lib/texture.glsl"
#include "pyrender/bent_normal.glsl"
#if LOOKUP
#include "lib/seen_normal.glsl"
#include "surface/gsgi_indirect.glsl"
#endif

#define GAMMA 2.2

uniform vec4 base_color;
in vec3 v_position;
in float v_depth;
#if NORMAL
in vec3 v_normal;
#endif
#if VERTEX_COLOR
in vec4 v_color;
#endif
#if TEXTURES
uniform highp sampler2D base_texture;
uniform vec2 base_mirror;
in vec2 v_uv;
#endif

#if LIT
uniform float metallic;
uniform float roughness;
uniform vec3 emission;
uniform vec3 ambient;
uniform vec3 eye;
#if TEXTURES
uniform highp sampler2D surface_texture;  // roughness, metallic
uniform highp sampler2D occlusion_texture;
uniform highp sampler2D emission_texture;
uniform vec2 surface_mirror;
uniform vec2 occlusion_mirror;
uniform vec2 emission_mirror;
#endif
#if NORMAL_TEXTURE
uniform highp sampler2D normal_texture;
uniform vec2 normal_mirror;
#endif
#if LIGHTS > 0
uniform vec3 light_place[LIGHTS];      // world-space position, m; for a directional light, the direction towards it
uniform float light_near[LIGHTS];      // 1; 0 for a directional light
uniform vec3 light_color[LIGHTS];
uniform vec3 light_direction[LIGHTS];  // direction in which the light travels
uniform vec2 light_cone[LIGHTS];       // scale and offset that map the cosine to [0, 1] across the edge
#endif
#if SHADOWS
uniform highp sampler2DShadow shadow_maps;  // tiles side by side
uniform mat4 map_from_world[LIGHTS];   // maps to [0, 1]
uniform vec2 tile_low[LIGHTS];         // corners of the light's tile, texture coordinates
uniform vec2 tile_high[LIGHTS];        // 0: no shadows
#endif
#if INDIRECT
uniform highp sampler2D indirect;
uniform highp sampler2D surface_depth;
#endif
#if INDIRECT || LOOKUP
uniform float black_metal;  // 1 if metals have no B, else 0
#endif
#endif

layout(location = 0) out vec4 out_color;

#if LIT
vec3 shading_normal(vec3 v) {
#if !NORMAL
    return v;
#elif NORMAL_TEXTURE
    vec3 texel = texture(normal_texture, mirrored(v_uv, normal_mirror)).xyz;
    return bent_normal(normalize(v_normal), v_position, v_uv, texel);
#else
    return normalize(v_normal);
#endif
}

#if SHADOWS
#define SHADOW_BIAS 0.001
#define SHADOW_BIAS_MIN 1e-4

float visibility(int i, float nl) {
    if (tile_high[i] == vec2(0.0)) return 1.0;
    vec4 p = map_from_world[i] * vec4(v_position, 1.0);
    vec3 place = p.xyz / p.w;
    if (place.z > 1.0) return 1.0;
    float depth = place.z - max(SHADOW_BIAS * (1.0 - nl), SHADOW_BIAS_MIN) / p.w;
    vec2 texel = 1.0 / vec2(textureSize(shadow_maps, 0));
    vec2 low = tile_low[i] + 0.5 * texel, high = tile_high[i] - 0.5 * texel;
    vec2 uv = mix(tile_low[i], tile_high[i], place.xy);
    float lit = 0.0;
    for (int tap = 0; tap < 9; ++tap) {
        vec2 offset = vec2(tap % 3, tap / 3) * texel;  // pyrender's filter is off-centre by one texel
        lit += texture(shadow_maps, vec3(clamp(uv + offset, low, high), depth)) / 9.0;
    }
    return lit;
}
#endif

vec3 primary_light(Surface surface, vec3 n, vec3 v) {
    vec3 sum = vec3(0.0);
#if LIGHTS > 0
    for (int i = 0; i < LIGHTS; ++i) {
        vec3 offset = light_place[i] - light_near[i] * v_position;
        vec3 l = normalize(offset);
        float attenuation = light_near[i] > 0.0 ? 1.0 / dot(offset, offset) : 1.0;
        float cosine = clamp(dot(light_direction[i], -l), 0.0, 1.0);
        float edge = clamp(cosine * light_cone[i].x + light_cone[i].y, 0.0, 1.0);
        vec3 light = edge * edge * attenuation * light_color[i] * reflected(surface, n, v, l);
#if SHADOWS
        light *= visibility(i, clamp(dot(n, l), 0.0, 1.0));
#endif
        sum += light;
    }
#endif
    return sum;
}

#if INDIRECT
#define SAME_DEPTH 0.01

// B of the fragment's surface. If the pixel's centre shows another surface, use the neighbour nearest in depth.
vec3 indirect_light(vec3 shading) {
    ivec2 centre = ivec2(gl_FragCoord.xy), last = textureSize(surface_depth, 0) - 1, best = centre;
    float off = abs(texelFetch(surface_depth, centre, 0).r - v_depth);
    if (off > SAME_DEPTH * v_depth) {
        for (int i = 0; i < 9; ++i) {
            ivec2 texel = clamp(centre + ivec2(i % 3 - 1, i / 3 - 1), ivec2(0), last);
            float d = abs(texelFetch(surface_depth, texel, 0).r - v_depth);
            if (d < off) {
                off = d;
                best = texel;
            }
        }
    }
    return texelFetch(indirect, best, 0).rgb;
}
#elif LOOKUP
uniform vec3 ahead;  // direction of parallel rays, world space; 0 if they come from the eye

vec3 indirect_light(vec3 shading) {
#if NORMAL
    vec3 interpolated = v_normal;
#else
    vec3 interpolated = vec3(0.0);
#endif
    vec3 toward = dot(ahead, ahead) > 0.0 ? ahead : v_position - eye;
    vec3 seen = seen_normal(v_position, toward, interpolated);
#if NORMAL_TEXTURE
    return gsgi_indirect(v_position, seen, dot(seen, interpolated) < 0.0 ? -shading : shading);
#else
    return gsgi_indirect(v_position, seen);
#endif
}
#endif

vec3 lit_color(vec3 base) {
    vec3 v = normalize(eye - v_position), shading = shading_normal(v);
    float metal = metallic, rough = roughness, occlusion = 1.0;
    vec3 glow = emission;
#if TEXTURES
    vec2 texel = texture(surface_texture, mirrored(v_uv, surface_mirror)).rg;
    rough *= texel.r;
    metal *= texel.g;
    occlusion = texture(occlusion_texture, mirrored(v_uv, occlusion_mirror)).r;
    glow *= linear_from_srgb(texture(emission_texture, mirrored(v_uv, emission_mirror)).rgb);
#endif
    metal = clamp(metal, 0.0, 1.0);
    rough = clamp(rough, DIELECTRIC, 1.0);
    Surface surface = Surface(
        base * (1.0 - DIELECTRIC) * (1.0 - metal), mix(vec3(DIELECTRIC), base, metal), rough);
    vec3 color = occlusion * (primary_light(surface, shading, v) + base * ambient);
#if INDIRECT || LOOKUP
    color += base * (1.0 - black_metal * metal) * indirect_light(shading);
#endif
    return color + glow * emission;  // pyrender applies the factor twice
}
#endif

void main() {
    vec4 color = base_color;
#if TEXTURES
    vec4 texel = texture(base_texture, mirrored(v_uv, base_mirror));
#if LIT
    texel.rgb = linear_from_srgb(texel.rgb);
#endif
    color *= texel;
#endif
#if LIT
    color.rgb = lit_color(color.rgb);
#endif
#if VERTEX_COLOR
    color *= v_color;
#endif
#if LIT
    color.rgb = pow(color.rgb, vec3(1.0 / GAMMA));
#endif
    out_color = clamp(color, 0.0, 1.0);
}
