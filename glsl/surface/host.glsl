// Decodes depth and normal of a pixel's surface from a host's textures, which may be encoded in several ways.
#include "lib/octahedral.glsl"

// How depth is encoded.
struct DepthCode {
    vec2 ends;      // texels at the near and at the far plane; nothing is seen beyond the near plane, nor from far on
    vec2 line;      // scale and offset from texels to z / w of the clip space or, without DEPTH_BUFFER, to metres
    vec2 z;         // columns of z and 1 of the projection's third row
    bool parallel;  // whether the projection is orthographic
};

// Distance along the view axis, m; 0: no surface.
float depth_from_texel(float stored, DepthCode code) {
    float decoded = code.line.x * stored + code.line.y;
#if DEPTH_BUFFER
    bool rising = code.ends.x < code.ends.y;
    bool seen = rising ? stored >= code.ends.x && stored < code.ends.y : stored <= code.ends.x && stored > code.ends.y;
    float depth = code.parallel ? (code.z.y - decoded) / code.z.x : code.z.y / (decoded + code.z.x);
    return seen ? depth : 0.0;
#else
    return stored != 0.0 ? decoded : 0.0;
#endif
}

// Unit normal in world space; 0 if the texel holds none. `world_from_view`: of the host's view space.
vec3 normal_from_texel(vec4 stored, mat4 world_from_view) {
#if NORMAL_OCTAHEDRAL
    vec3 n = normal_from_octahedral(stored.xy);
#elif NORMAL_OCTAHEDRAL_UNSIGNED  // both numbers mapped from -1..1 to 0..1
    vec3 n = normal_from_octahedral(2.0 * stored.xy - 1.0);
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
