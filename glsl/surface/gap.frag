// Closes the depth buffer where the fine level alone weighs enough: of the coarse level nothing is drawn there.

uniform highp sampler2D fine_sums;
uniform float weight_floor;

void main() {
    // Elsewhere the depth of the surface stays.
    if (texelFetch(fine_sums, ivec2(gl_FragCoord.xy), 0).a < weight_floor) discard;
    gl_FragDepth = 0.0;  // nothing is nearer
}
