// Metallic-roughness shading with the terms, clamps and epsilons of pyrender 0.1.45.
#include "lib/constants.glsl"

#define DIELECTRIC 0.04     // reflectance at normal incidence; also the minimum roughness
#define COSINE_MIN 0.001    // surfaces that face away count as lit at a grazing angle
#define SPECULAR_BIAS 0.001  // added to the denominator

struct Surface {
    vec3 diffuse;   // c_diff
    vec3 specular;  // f0
    float roughness;  // perceptual
};

// BRDF for light from `l` that leaves towards `v`, times n . l. All vectors are unit vectors.
vec3 reflected(Surface surface, vec3 n, vec3 v, vec3 l) {
    vec3 h = normalize(l + v);
    float nl = clamp(dot(n, l), COSINE_MIN, 1.0);
    float nv = clamp(abs(dot(n, v)), COSINE_MIN, 1.0);
    float nh = clamp(dot(n, h), 0.0, 1.0);
    float vh = clamp(dot(v, h), 0.0, 1.0);
    // Karis 2013, "Real Shading in Unreal Engine 4": GGX, Schlick's Fresnel term and his fit of Smith's shadowing
    vec3 fresnel = surface.specular + (1.0 - surface.specular) * pow(1.0 - vh, 5.0);
    float k = (surface.roughness + 1.0) * (surface.roughness + 1.0) / 8.0;
    float shadowing = nv / (nv * (1.0 - k) + k) * nl / (nl * (1.0 - k) + k);
    float a2 = surface.roughness * surface.roughness * surface.roughness * surface.roughness;
    float slope = nh * nh * (a2 - 1.0) + 1.0;
    float distribution = a2 / (PI * slope * slope);
    vec3 lobe = fresnel * shadowing * distribution / (4.0 * nl * nv + SPECULAR_BIAS);
    return nl * ((1.0 - fresnel) * surface.diffuse / PI + lobe);
}
