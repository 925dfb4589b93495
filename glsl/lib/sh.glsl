// Real spherical harmonics, orthonormal on the sphere, with the Condon-Shortley phase. The define SH_DEGREE is the
// degree, 0 to 3. Order (l, m): 0,0; 1,-1 1,0 1,1; ...
#include "lib/constants.glsl"

#define SH_COUNT ((SH_DEGREE + 1) * (SH_DEGREE + 1))

// Values of the basis functions in the unit direction `d`.
void sh_basis(vec3 d, out float basis[SH_COUNT]) {
    // Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps"; signs as in
    // Kerbl et al. 2023
    basis[0] = SH_C0;
#if SH_DEGREE > 0
    vec3 first = SH_C1 * d;
    basis[1] = -first.y;
    basis[2] = first.z;
    basis[3] = -first.x;
#endif
#if SH_DEGREE > 1
    vec3 second = SH_C2_0 * d, squares = d * d;
    basis[4] = second.x * d.y;
    basis[5] = -second.y * d.z;
    basis[6] = SH_C2_1 * (2.0 * squares.z - squares.x - squares.y);
    basis[7] = -second.x * d.z;
    basis[8] = SH_C2_2 * (squares.x - squares.y);
#endif
#if SH_DEGREE > 2
    float xx = squares.x, yy = squares.y, zz = squares.z;
    basis[9] = -SH_C3_0 * d.y * (3.0 * xx - yy);
    basis[10] = SH_C3_1 * d.x * d.y * d.z;
    basis[11] = -SH_C3_2 * d.y * (4.0 * zz - xx - yy);
    basis[12] = SH_C3_3 * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
    basis[13] = -SH_C3_2 * d.x * (4.0 * zz - xx - yy);
    basis[14] = SH_C3_4 * d.z * (xx - yy);
    basis[15] = -SH_C3_0 * d.x * (xx - 3.0 * yy);
#endif
}

// Value in the unit direction `d` of the function with these coefficients.
vec3 sh_sum(vec3 coefficients[SH_COUNT], vec3 d) {
    float basis[SH_COUNT];
    sh_basis(d, basis);
    vec3 sum = vec3(0.0);
    for (int k = 0; k < SH_COUNT; ++k) sum += basis[k] * coefficients[k];
    return sum;
}
