// Interpolated and mapped normals of a surface.

vec3 unit_or(vec3 v, vec3 fallback) {
    return dot(v, v) > 0.0 ? normalize(v) : fallback;
}

// Normal of a tangent-space texel in [0, 1]. `n`: interpolated unit normal; `tangent`: interpolated, w < 0 where the
// texture is mirrored; `scale`: factor of the slope.
vec3 mapped_normal(vec3 n, vec4 tangent, vec3 texel, float scale) {
    // Lengyel 2001, "Computing Tangent Space Basis Vectors for an Arbitrary Mesh": Gram-Schmidt, then the third axis
    vec3 t = tangent.xyz - n * dot(n, tangent.xyz);
    if (!(dot(t, t) > 0.0)) return n;
    t = normalize(t);
    vec3 b = (tangent.w < 0.0 ? -1.0 : 1.0) * cross(n, t);
    vec3 m = (2.0 * texel - 1.0) * vec3(scale, scale, 1.0);
    return unit_or(m.x * t + m.y * b + m.z * n, n);
}
