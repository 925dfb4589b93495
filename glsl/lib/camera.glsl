// Pinhole camera: view space looks down -Z, pixel rows go down, pixel centres lie at +0.5.

// Pixel position of gl_FragCoord, which counts rows upwards. `height` is in px.
vec2 pixel_from_fragment(vec2 fragment, float height) {
    return vec2(fragment.x, height - fragment.y);
}

// World-space position, m, of what `fragment` shows at `depth`, m. `axis`: the fragment (px) on the view axis;
// `world_from_offset` transforms (depth * (fragment - axis, 1), 1) to world space.
vec3 world_from_fragment(vec2 fragment, float depth, vec2 axis, mat4 world_from_offset) {
    return (world_from_offset * vec4(depth * vec3(fragment - axis, 1.0), 1.0)).xyz;
}

// What `world_from_offset` transforms to world space. If rays are `parallel`, that is (fragment - axis, depth, 1).
vec4 offset_from_fragment(vec2 fragment, float depth, vec2 axis, bool parallel) {
    vec2 across = fragment - axis;
    return vec4(parallel ? across : depth * across, depth, 1.0);
}

vec3 world_from_fragment(vec2 fragment, float depth, vec2 axis, mat4 world_from_offset, bool parallel) {
    return (world_from_offset * offset_from_fragment(fragment, depth, axis, parallel)).xyz;
}

// Distance, m, that says how coarse pixels are at `depth`: parallel rays count as from as far as the image is high.
float viewing_distance(float depth, float height, mat4 world_from_offset, bool parallel) {
    return parallel ? length(world_from_offset[1].xyz) * height : depth;
}

vec2 pixel_from_view(vec3 position, vec2 focal, vec2 centre) {
    return centre + focal * vec2(position.x, -position.y) / -position.z;
}

// Value, 0 to 1, in a depth buffer for `depth` in m.
float window_depth(float depth, float near) {
    return 1.0 - near / depth;
}
