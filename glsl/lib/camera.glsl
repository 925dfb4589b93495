// Pinhole camera: view space looks down -Z, pixel rows go down, pixel centres lie at +0.5.

// gl_FragCoord counts rows upwards; `height` in px.
vec2 pixel_from_fragment(vec2 fragment, float height) {
    return vec2(fragment.x, height - fragment.y);
}

// World space, m, of what `fragment` shows at `depth`, m. `axis`: the fragment (px) on the view's axis; the matrix takes
// depth * (offset from there, 1) and 1 to world space.
vec3 world_from_fragment(vec2 fragment, float depth, vec2 axis, mat4 world_from_offset) {
    return (world_from_offset * vec4(depth * vec3(fragment - axis, 1.0), 1.0)).xyz;
}

vec2 pixel_from_view(vec3 position, vec2 focal, vec2 centre) {
    return centre + focal * vec2(position.x, -position.y) / -position.z;
}

// What the depth buffer of the surface points holds, 0 to 1, for `depth` in m.
float window_depth(float depth, float near) {
    return 1.0 - near / depth;
}
