// Normals and depth of the nearest surface: the part of a G-buffer that the passes that read Gaussians need.
#include "lib/octahedral.glsl"
#include "lib/seen_normal.glsl"
#if NORMAL_TEXTURE
#include "lib/texture.glsl"
#include "pyrender/bent_normal.glsl"
#endif

uniform vec3 ahead;  // direction of parallel rays, world space; 0 if they come from the eye

in vec3 v_offset;
in float v_depth;
#if NORMAL
in vec3 v_normal;
#endif
#if NORMAL_TEXTURE
uniform highp sampler2D normal_texture;
uniform vec2 normal_mirror;
in vec2 v_uv;
#endif

layout(location = 0) out vec4 out_normal;  // octahedral, on the camera's side
layout(location = 1) out vec4 out_depth;   // m
#if RELIEF
layout(location = 2) out vec4 out_mapped;  // as out_normal, with the normal map
#endif

void main() {
#if NORMAL
    vec3 interpolated = v_normal;
#else
    vec3 interpolated = vec3(0.0);
#endif
    vec3 toward = dot(ahead, ahead) > 0.0 ? ahead : v_offset;
    vec3 seen = seen_normal(v_offset, toward, interpolated);
    out_normal = vec4(octahedral_from_normal(seen), 0.0, 1.0);
    out_depth = vec4(v_depth, 0.0, 0.0, 1.0);
#if RELIEF
    vec3 mapped = seen;
#if NORMAL_TEXTURE
    vec3 texel = texture(normal_texture, mirrored(v_uv, normal_mirror)).xyz;
    vec3 bent = bent_normal(normalize(v_normal), v_offset, v_uv, texel);
    mapped = unit_or(dot(seen, v_normal) < 0.0 ? -bent : bent, seen);
#endif
    out_mapped = vec4(octahedral_from_normal(mapped), 0.0, 1.0);
#endif
}
