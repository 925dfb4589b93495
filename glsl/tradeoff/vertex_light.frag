// The G-buffer pass with one more target: B interpolated between vertices (Gouraud 1971).
#define main surface
#include "frame/gbuffer.frag"
#undef main

in vec3 v_light;  // B, linear

#if INTERPOLATED
layout(location = 5) out vec4 out_indirect;
#else
layout(location = 4) out vec4 out_indirect;
#endif

void main() {
    surface();
    out_indirect = vec4(v_light, 1.0);
}
