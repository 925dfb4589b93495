// Closes the depth buffer where the fine level alone has enough weight, so that the coarse level is not drawn there.

uniform highp sampler2D fine_sums;
uniform float weight_floor;

void main() {
    // Elsewhere the depth of the surface is kept.
    if (texelFetch(fine_sums, ivec2(gl_FragCoord.xy), 0).a < weight_floor) discard;
    gl_FragDepth = 0.0;  // nothing is nearer
}
