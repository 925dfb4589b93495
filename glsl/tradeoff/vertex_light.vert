// The G-buffer pass with one more attribute: B at a vertex.
#define main surface
#include "frame/gbuffer.vert"
#undef main

in vec3 light;
out vec3 v_light;

void main() {
    surface();
    v_light = light;
}
