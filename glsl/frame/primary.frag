// Direct light of one punctual light that the surface reflects towards the eye. Added to the target.
#include "lib/camera.glsl"
#include "frame/light.glsl"
#include "lib/octahedral.glsl"
#include "frame/shadow.glsl"

uniform highp sampler2D albedo;
uniform highp sampler2D normal;
uniform highp sampler2D depth;
uniform highp sampler2D shadow_atlas;

uniform mat4 world_from_offset;
uniform vec2 axis;

uniform vec3 light_color;
uniform vec3 light_position;
uniform vec3 light_direction;  // direction in which the light travels, unit
uniform float light_inverse_range;
uniform vec2 light_cone;       // cos_inner, cos_outer

uniform mat4 atlas_from_world[FACES];
uniform vec4 depth_from_world[FACES];
uniform vec3 face_axis[FACES];
uniform vec2 texel_size;       // m: constant part, part per unit of shadow depth
uniform float casts;           // 1 if the surfaces are in the atlas themselves, 0 if they may not be

layout(location = 0) out vec4 out_radiance;

float visibility(vec3 position, vec3 wi, vec3 face_normal, float view_depth) {
#if FACES == 1
    int face = 0;
#else
    int face = cube_face(position - light_position);
#endif
    float texel = texel_size.x + texel_size.y * dot(depth_from_world[face], vec4(position, 1.0));
    float cosine = dot(face_normal, face_axis[face]);
    float lift = shadow_lift(texel, cosine, view_depth);
    vec3 lifted = position + lift * face_normal + SHADOW_PULL * texel * wi;
    // Across a texel, the depth of the plane changes by its slope as the light sees it; and the position was lifted.
    float sine = sqrt(max(0.0, 1.0 - cosine * cosine));
    float slope = sine * abs(dot(face_axis[face], wi)) / max(abs(dot(face_normal, wi)), 1e-3);
    float reach = length(depth_from_world[face].xyz) * (texel * (2.0 * slope + 2.0 * SHADOW_PULL) + 2.0 * lift);
    if (casts < 0.5) reach = 1.0;
    return shadow_visibility(shadow_atlas, atlas_from_world[face], depth_from_world[face], lifted, reach);
}

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float view_depth = texelFetch(depth, texel, 0).r;
    if (view_depth <= 0.0) discard;
    vec3 position = world_from_fragment(gl_FragCoord.xy, view_depth, axis, world_from_offset);
    vec4 normals = texelFetch(normal, texel, 0);

#if DIRECTIONAL
    vec3 wi = -light_direction;
    float attenuation = 1.0;
#else
    vec3 offset = light_position - position;
    float distance_to_light = length(offset);
    vec3 wi = offset / distance_to_light;
    float attenuation = range_attenuation(distance_to_light, light_inverse_range);
#endif
#if SPOT
    attenuation *= cone_attenuation(dot(-wi, light_direction), light_cone.x, light_cone.y);
#endif
    float n_dot_l = dot(normal_from_octahedral(normals.xy), wi);
    vec3 face_normal = normal_from_octahedral(normals.zw);
    // Written so that NaN (a light on the surface) counts as dark.
    if (!(n_dot_l * attenuation > 0.0 && dot(face_normal, wi) > 0.0)) discard;
    float lit = visibility(position, wi, face_normal, view_depth);
    vec3 radiance = texelFetch(albedo, texel, 0).rgb / PI * light_color * (attenuation * n_dot_l * lit);
    out_radiance = vec4(min(radiance, vec3(HALF_MAX)), 0.0);
}
