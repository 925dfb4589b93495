// Normal and depth of the nearest surface: the part of a G-buffer that the passes that read Gaussians need.
#include "lib/octahedral.glsl"
#include "lib/seen_normal.glsl"

uniform vec3 ahead;  // direction of parallel rays, world space; 0 if they come from the eye

in vec3 v_offset;
in float v_depth;
#if NORMAL
in vec3 v_normal;
#endif

layout(location = 0) out vec4 out_normal;  // octahedral, on the camera's side
layout(location = 1) out vec4 out_depth;   // m

void main() {
#if NORMAL
    vec3 interpolated = v_normal;
#else
    vec3 interpolated = vec3(0.0);
#endif
    vec3 toward = dot(ahead, ahead) > 0.0 ? ahead : v_offset;
    out_normal = vec4(octahedral_from_normal(seen_normal(v_offset, toward, interpolated)), 0.0, 1.0);
    out_depth = vec4(v_depth, 0.0, 0.0, 1.0);
}
