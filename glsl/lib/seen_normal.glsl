// The normal at which B is read: the interpolated one, on the side that is seen.
#include "lib/normal_map.glsl"

// `position`: m, from any origin; `toward`: from the eye to it, or the direction of view, of any length; `interpolated`:
// of any length, 0 where vertices have none. For fragment shaders: the triangle's own normal is found by derivatives.
vec3 seen_normal(vec3 position, vec3 toward, vec3 interpolated) {
    vec3 face = unit_or(cross(dFdx(position), dFdy(position)), -toward);
    face *= dot(face, toward) > 0.0 ? -1.0 : 1.0;
    vec3 n = unit_or(interpolated, face);
    return dot(n, face) < 0.0 ? -n : n;
}
