// The G-buffer pass with one more target: B from a lightmap, filtered bilinearly (Abrash 1997, "Quake's Lighting Model").
#define main surface
#include "frame/gbuffer.frag"
#undef main

uniform highp sampler2D lightmap;  // B, linear
in vec2 v_atlas_uv;

#if INTERPOLATED
layout(location = 5) out vec4 out_indirect;
#else
layout(location = 4) out vec4 out_indirect;
#endif

void main() {
    surface();
    out_indirect = vec4(textureLod(lightmap, v_atlas_uv, 0.0).rgb, 1.0);
}
