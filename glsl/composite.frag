// L = primary + albedo * B on surfaces, 0 elsewhere.

uniform highp sampler2D albedo;
uniform highp sampler2D depth;
uniform highp sampler2D primary;
uniform highp sampler2D indirect;

layout(location = 0) out vec4 out_radiance;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    if (texelFetch(depth, texel, 0).r <= 0.0) discard;
    vec3 reflected = texelFetch(albedo, texel, 0).rgb * texelFetch(indirect, texel, 0).rgb;
    out_radiance = vec4(texelFetch(primary, texel, 0).rgb + reflected, 1.0);
}
