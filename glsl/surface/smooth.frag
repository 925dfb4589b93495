// Upsamples where all pixels of a square show one smooth surface: B is then linear between its points. The depth buffer
// keeps surface/resolve.frag from these pixels.
#include "lib/constants.glsl"
#include "surface/taps.glsl"

uniform highp sampler2D filled_sums;

layout(location = 0) out vec4 out_indirect;  // B; elsewhere 0

void main() {
    Taps taps = nearest_taps(ivec2(gl_FragCoord.xy), SPLAT_SCALE, textureSize(filled_sums, 0) - 1);
    vec4 low = texelFetch(filled_sums, taps.low, 0);
    bool is_smooth = low.a < 0.0;
    vec4 sum = taps.weights.x * unsigned_sums(low)
             + taps.weights.y * unsigned_sums(texelFetch(filled_sums, taps.other, 0))
             + taps.weights.z * unsigned_sums(texelFetch(filled_sums, taps.high, 0));
    out_indirect = vec4(is_smooth ? clamp(sum.rgb / sum.a, 0.0, HALF_MAX) : vec3(0.0), 1.0);
    gl_FragDepth = is_smooth ? 0.0 : 1.0;
}
