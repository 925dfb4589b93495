// Draws the near side of one ellipsoid in one colour, darker where the surface turns away.
#include "lib/camera.glsl"

uniform vec2 focal;   // px
uniform vec2 centre;  // px
uniform vec2 size;    // px
uniform float near;   // m

flat in vec3 v_eye;
flat in mat3 v_whiten;
flat in vec3 v_color;

layout(location = 0) out vec4 out_color;

#define EDGE 0.3  // factor of the colour where the surface is seen edge-on

void main() {
    vec2 slope = (pixel_from_fragment(gl_FragCoord.xy, size.y) - centre) / focal;
    vec3 ray = vec3(slope.x, -slope.y, -1.0);
    vec3 d = ray * v_whiten;
    // Intersect eye + depth * d with the unit sphere by the ray's distance from its centre, which cannot cancel.
    vec3 apart = cross(v_eye, d);
    float square = dot(d, d), rest = square - dot(apart, apart);
    if (!(rest >= 0.0)) discard;
    float depth = (-dot(v_eye, d) - sqrt(rest)) / square;
    if (!(depth >= near)) discard;  // the near side is cut by the near plane, or lies behind the eye
    vec3 normal = normalize(v_whiten * (v_eye + depth * d));
    out_color = vec4(v_color * mix(EDGE, 1.0, abs(dot(normal, normalize(ray)))), 1.0);
    gl_FragDepth = window_depth(depth, near);
}
