// Writes linear depth. It is as precise far away as near the light, so the near plane may be arbitrarily close.
#include "lib/texture.glsl"

#if ALPHA_MASK
uniform float base_alpha;
uniform float alpha_cutoff;
#if VERTEX_COLOR
in float v_alpha;
#endif
#if BASE_TEXTURE
uniform highp sampler2D base_texture;
uniform vec2 base_mirror;
in vec2 v_base_uv;
#endif
#endif

in float v_depth;
uniform vec2 back_pull;  // depth: constant part, part per unit of depth; 0 where the back can be lit too

void main() {
#if ALPHA_MASK
    float alpha = base_alpha;
#if VERTEX_COLOR
    alpha *= v_alpha;
#endif
#if BASE_TEXTURE
    alpha *= texture(base_texture, mirrored(v_base_uv, base_mirror)).a;
#endif
    if (alpha < alpha_cutoff) discard;
#endif
    // Receivers are pulled towards the light, but not through the back of a wall, which itself receives none of it.
    float pull = gl_FrontFacing ? 0.0 : back_pull.x + back_pull.y * v_depth;
    gl_FragDepth = clamp(v_depth - pull, 0.0, 1.0);
}
