// A picture of text over what is there. Blended premultiplied: ONE, ONE_MINUS_SRC_ALPHA.
uniform highp sampler2D text;  // row 0 on top
uniform vec2 corner;           // px; the lower left one of the text in the target
uniform int scale;             // px of the target per texel

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 texel = (ivec2(gl_FragCoord.xy) - ivec2(corner)) / scale;
    out_color = texelFetch(text, ivec2(texel.x, textureSize(text, 0).y - 1 - texel.y), 0);
}
