// Decodes depth and normal of a pixel's surface from a host's textures, which may be encoded in several ways.
#include "lib/octahedral.glsl"

// Distance along the view axis, m; 0: no surface. `z`: the columns of z and 1 of the projection's third row.
float depth_from_texel(float stored, vec2 z) {
#if DEPTH_WINDOW  // a depth buffer: 0 is near, 1 is empty
    return stored < 1.0 ? z.y / (2.0 * stored - 1.0 + z.x) : 0.0;
#elif DEPTH_REVERSED  // a depth buffer: 1 is near, 0 is empty
    return stored > 0.0 ? z.y / (stored + z.x) : 0.0;
#else
    return stored;
#endif
}

// Unit normal in world space; 0 if the texel holds none.
vec3 normal_from_texel(vec4 stored, mat4 world_from_view) {
#if NORMAL_OCTAHEDRAL
    vec3 n = normal_from_octahedral(stored.xy);
#elif NORMAL_UNSIGNED  // each component mapped from -1..1 to 0..1
    vec3 n = 2.0 * stored.xyz - 1.0;
#else
    vec3 n = stored.xyz;
#endif
#if NORMAL_VIEW_SPACE
    n = mat3(world_from_view) * n;
#endif
    return dot(n, n) > 0.0 ? normalize(n) : vec3(0.0);
}
