// Texture addressing that the sampler does not support.

// Fold the axes with `mirror` = 1 into [0, 1]; with clamped edges this equals a mirrored repeat.
vec2 mirrored(vec2 uv, vec2 mirror) {
    return mix(uv, 1.0 - abs(mod(uv, 2.0) - 1.0), mirror);
}
