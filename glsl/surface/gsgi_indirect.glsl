// The look-up for a host's own shaders, of any stage: include this, bind three textures, call one function.
#include "surface/lookup.glsl"

uniform highp sampler2D gsgi_gaussians;
uniform highp usampler2D gsgi_cells, gsgi_lists;

vec3 gsgi_read(vec3 position, vec3 normal, vec3 mapped, bool free) {
    vec4 sums = look_up(gsgi_gaussians, gsgi_cells, gsgi_lists, position, normal, mapped, free);
    return clamp(sums.a > 0.0 ? sums.rgb / sums.a : vec3(0.0), 0.0, HALF_MAX);
}

// B, linear Rec.709 radiance for albedo 1: add albedo * B to the radiance of a surface. `position`: world space, m;
// `normal`: world space, towards the side that is seen, before any normal map; `mapped`: after it, where there is one.
// Lengths of normals do not matter, but those of length 0 get no light. For files whose light does not follow normal
// maps both functions are the same.
vec3 gsgi_indirect(vec3 position, vec3 normal, vec3 mapped) {
    return gsgi_read(position, normal, mapped, false);
}

vec3 gsgi_indirect(vec3 position, vec3 normal) {
    return gsgi_indirect(position, normal, normal);
}

// The same for what was not in the scene when it was baked, and moves: the light of free space. Close to a baked surface
// gsgi_indirect would give the light of that surface. `normal`: after any normal map. It is faster, too.
vec3 gsgi_indirect_free(vec3 position, vec3 normal) {
    return gsgi_read(position, normal, normal, true);
}
