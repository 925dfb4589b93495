// The same B at every surface: the constant ambient light of Phong (1975).

uniform highp sampler2D depth;
uniform vec3 light;  // radiance

layout(location = 0) out vec4 out_indirect;

void main() {
    bool seen = texelFetch(depth, ivec2(gl_FragCoord.xy), 0).x > 0.0;
    out_indirect = vec4(seen ? light : vec3(0.0), 1.0);
}
