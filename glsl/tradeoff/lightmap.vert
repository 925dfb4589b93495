// The G-buffer pass with one more attribute: where a vertex lies in the lightmap.
#define main surface
#include "frame/gbuffer.vert"
#undef main

in vec2 atlas_uv;
out vec2 v_atlas_uv;

void main() {
    surface();
    v_atlas_uv = atlas_uv;
}
