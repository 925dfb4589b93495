// Which points of a target at lower resolution a pixel interpolates.

// The triangle of the three nearest points: two opposite corners of a square, one other.
struct Taps {
    ivec2 low, other, high;
    vec3 weights;  // of the three, linear over the triangle
    ivec2 square;  // the lower corner of the square, which may lie outside of the target
};

// `last`: the highest texel of the target. Points lie in pixel splat_scale / 2 of their blocks.
Taps nearest_taps(ivec2 texel, int splat_scale, ivec2 last) {
    vec2 place = vec2(texel - splat_scale / 2) / float(splat_scale), part = fract(place);
    ivec2 square = ivec2(floor(place)), low = clamp(square, ivec2(0), last), high = clamp(square + 1, ivec2(0), last);
    float far = max(part.x, part.y), near = min(part.x, part.y);
    ivec2 other = part.x > part.y ? ivec2(high.x, low.y) : ivec2(low.x, high.y);
    return Taps(low, other, high, vec3(1.0 - far, far - near, near), square);
}

// Sums of a point, without the sign by which surface/read.frag tells smooth squares.
vec4 unsigned_sums(vec4 filled) {
    return vec4(filled.rgb, abs(filled.a));
}
