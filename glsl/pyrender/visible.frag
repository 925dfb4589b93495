// Normal and depth of the nearest surface: the part of a G-buffer that the passes that read Gaussians need.
#include "lib/octahedral.glsl"
#include "lib/normal_map.glsl"

in vec3 v_offset;
in float v_depth;
#if NORMAL
in vec3 v_normal;
#endif

layout(location = 0) out vec4 out_normal;  // octahedral, on the camera's side
layout(location = 1) out vec4 out_depth;   // m

void main() {
    vec3 face = unit_or(cross(dFdx(v_offset), dFdy(v_offset)), -v_offset);
    face *= dot(face, v_offset) > 0.0 ? -1.0 : 1.0;
    vec3 n = face;
#if NORMAL
    n = unit_or(v_normal, face);
    n *= dot(n, face) < 0.0 ? -1.0 : 1.0;
#endif
    out_normal = vec4(octahedral_from_normal(n), 0.0, 1.0);
    out_depth = vec4(v_depth, 0.0, 0.0, 1.0);
}
