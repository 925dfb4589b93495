// Adds what panda3d/light drew to the frame of a Panda3D camera. Blended ONE, ONE; alpha is unchanged.

uniform sampler2D light;
uniform vec2 corner;  // px; of the camera's view in the frame

layout(location = 0) out vec4 out_radiance;

void main() {
    out_radiance = vec4(texelFetch(light, ivec2(gl_FragCoord.xy - corner), 0).rgb, 0.0);
}
