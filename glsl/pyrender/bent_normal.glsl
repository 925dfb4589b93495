// A normal map without tangents, as pyrender reads it.

// The unit normal `n` of a surface as a texel in [0, 1] bends it. `position`: m, from any origin. For fragment shaders:
// the texture's axes are found by derivatives; not a number where texture coordinates do not change.
vec3 bent_normal(vec3 n, vec3 position, vec2 uv, vec3 texel) {
    // Schüler 2013, "Normal Mapping Without Precomputed Tangents"
    vec3 position_dx = dFdx(position), position_dy = dFdy(position);
    vec2 uv_dx = dFdx(uv), uv_dy = dFdy(uv);
    vec3 t = (uv_dy.y * position_dx - uv_dx.y * position_dy) / (uv_dx.x * uv_dy.y - uv_dy.x * uv_dx.y);
    t = normalize(t - n * dot(n, t));
    return normalize(mat3(t, normalize(cross(n, t)), n) * (2.0 * texel - 1.0));
}
