// Visibility of a light from a point, from an atlas of linear depths. A light has one face, or six if it is a
// point light: +X -X +Y -Y +Z -Z.
#include "lib/constants.glsl"

// Face of the cube around a point light through which the direction `d` passes.
int cube_face(vec3 d) {
    vec3 a = abs(d);
    if (a.x >= a.y && a.x >= a.z) return d.x > 0.0 ? 0 : 1;
    if (a.y >= a.z) return d.y > 0.0 ? 2 : 3;
    return d.z > 0.0 ? 4 : 5;
}

// Offset from the surface, in m, that keeps a plane from shadowing itself. `texel`: edge length of a texel there, m;
// `n_dot_axis`: cosine between the triangle's normal and the face's axis; `view_depth`: depth from which the position
// was reconstructed, m.
float shadow_lift(float texel, float n_dot_axis, float view_depth) {
    // Holbert 2011, "Saying Goodbye to Shadow Acne" (normal offset). At r texels away, the plane can be nearer to the
    // light than the receiver by r * texel * tan(slope). Along the normal this is r * texel * sin(slope), at any slope.
    float sine = sqrt(max(0.0, 1.0 - n_dot_axis * n_dot_axis));
    return texel * SHADOW_PCF_RADIUS * sine + SHADOW_POSITION_ERROR * view_depth;
}

// Filtered 2x2 comparison: 1 is lit, 0 is in shadow. `atlas_from_world` maps to texture coordinates. `reach`: how much
// deeper than `position` its own surface can be within the filter. A texel that is deeper shows what lies beyond the
// edge of that surface, and tells nothing: where floor and wall meet, light behind the wall would leak in.
float shadow_visibility(
    highp sampler2D atlas, mat4 atlas_from_world, vec4 depth_from_world, vec3 position, float reach
) {
    vec4 p = atlas_from_world * vec4(position, 1.0);
    float depth = dot(depth_from_world, vec4(position, 1.0));
    vec2 texels = p.xy / p.w * vec2(textureSize(atlas, 0)) - 0.5;
    vec2 last = vec2(textureSize(atlas, 0) - 1);
    if (any(lessThan(texels, vec2(0.0))) || any(greaterThanEqual(texels, last))) return 1.0;  // beyond all casters
    ivec2 corner = ivec2(floor(texels));
    vec2 share = texels - vec2(corner);
    vec4 weights = vec4(1.0 - share.x, share.x, 1.0 - share.x, share.x) * vec4(vec2(1.0 - share.y), vec2(share.y));
    vec4 stored = vec4(
        texelFetch(atlas, corner, 0).r, texelFetch(atlas, corner + ivec2(1, 0), 0).r,
        texelFetch(atlas, corner + ivec2(0, 1), 0).r, texelFetch(atlas, corner + ivec2(1, 1), 0).r
    );
    float lit = dot(weights, step(vec4(depth), stored) * step(stored, vec4(depth + reach)));
    float shadowed = dot(weights, 1.0 - step(vec4(depth), stored));
    return lit + shadowed > 0.0 ? lit / (lit + shadowed) : 1.0;
}
