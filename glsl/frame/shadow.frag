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
    gl_FragDepth = clamp(v_depth, 0.0, 1.0);
}
