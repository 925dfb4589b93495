// Closes the depth buffer where the fine level alone has enough weight, so that the coarse level is not drawn there.

uniform highp sampler2D fine_sums;
#if SECTORS
uniform highp sampler2D surface_position;
#endif
uniform float weight_floor;

void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    float enough = weight_floor;
#if SECTORS
    enough *= texelFetch(surface_position, texel, 0).w;
#endif
    // Elsewhere the depth of the surface is kept.
    if (texelFetch(fine_sums, texel, 0).a < enough) discard;
    gl_FragDepth = 0.0;  // nothing is nearer
}
