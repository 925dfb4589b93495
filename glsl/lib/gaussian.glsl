// Gaussians in RGBA32F data textures, row-major, DATA_WIDTH texels wide; read by texelFetch.
//
// shape texture, 3 texels per Gaussian:  (position xyz, opacity) (rotation xyzw) (scale xyz, 0)
// sh texture, SH_TEXELS per Gaussian:    its K * 3 floats, coefficient by coefficient, padded with 0
#include "lib/sh.glsl"

#define DATA_WIDTH    2048  // texels; every WebGL2 device supports textures this wide
#define DATA_SHIFT    11    // 2 to the power of this is DATA_WIDTH
#define SHAPE_TEXELS  3
#define SH_TEXELS     ((SH_COUNT * 3 + 3) / 4)

struct Gaussian {
    vec3 position;  // world space, m
    float opacity;  // [0, 1]
    vec4 rotation;  // unit quaternion xyzw
    vec3 scale;     // standard deviation along each axis, m
};

vec4 fetch_data(highp sampler2D data, int texel) {
    return texelFetch(data, ivec2(texel & (DATA_WIDTH - 1), texel >> DATA_SHIFT), 0);
}

Gaussian fetch_gaussian(highp sampler2D shape, int index) {
    vec4 first = fetch_data(shape, index * SHAPE_TEXELS);
    vec4 rotation = fetch_data(shape, index * SHAPE_TEXELS + 1);
    vec4 last = fetch_data(shape, index * SHAPE_TEXELS + 2);
    return Gaussian(first.xyz, first.w, rotation, last.xyz);
}

// SH coefficients of Gaussian `index`.
void fetch_sh(highp sampler2D sh, int index, out vec3 coefficients[SH_COUNT]) {
    float values[SH_TEXELS * 4];
    for (int i = 0; i < SH_TEXELS; ++i) {
        vec4 v = fetch_data(sh, index * SH_TEXELS + i);
        values[4 * i] = v.x;
        values[4 * i + 1] = v.y;
        values[4 * i + 2] = v.z;
        values[4 * i + 3] = v.w;
    }
    for (int k = 0; k < SH_COUNT; ++k)
        coefficients[k] = vec3(values[3 * k], values[3 * k + 1], values[3 * k + 2]);
}

// Light of Gaussian `index` for the unit direction `d` in world space: from the camera to its centre (`over` operator)
// or a normal (`surface` operator).
vec3 fetch_color(highp sampler2D sh, int index, vec3 d) {
    vec3 coefficients[SH_COUNT];
    fetch_sh(sh, index, coefficients);
    return clamp(sh_sum(coefficients, d), 0.0, HALF_MAX);
}
