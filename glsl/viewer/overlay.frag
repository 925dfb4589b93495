// Draws an image of text over the target. Blended premultiplied: ONE, ONE_MINUS_SRC_ALPHA.
uniform highp sampler2D text;  // row 0 at the top
uniform vec2 corner;           // px; lower left corner of the text in the target
uniform int scale;             // px of the target per texel

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 texel = (ivec2(gl_FragCoord.xy) - ivec2(corner)) / scale;
    out_color = texelFetch(text, ivec2(texel.x, textureSize(text, 0).y - 1 - texel.y), 0);
}
