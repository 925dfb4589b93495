// What a layer of partly transparent surfaces lets through of the frame behind it: a factor on the target.

uniform highp sampler2D albedo;   // a: opacity
uniform highp sampler2D primary;  // a: how far the albedo tints what is behind
uniform highp sampler2D depth;    // 0 = no surface

layout(location = 0) out vec4 out_factor;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    if (texelFetch(depth, texel, 0).r <= 0.0) discard;
    vec4 surface = texelFetch(albedo, texel, 0);
    float tint = texelFetch(primary, texel, 0).a;
    out_factor = vec4((1.0 - surface.a) * mix(vec3(1.0), surface.rgb, tint), 1.0);
}
