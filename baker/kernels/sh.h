// Real spherical harmonics up to degree 3 and their derivatives.
//
// Orthonormal, Condon-Shortley phase, as in Kerbl et al. 2023. The direction is a unit vector; the
// derivatives are those of the polynomials as written, so a caller projects them onto the sphere.
#pragma once

#include "constants.glsl"
#include "linear.h"

constexpr int SH_MAX = 16;

// Basis values of degree^2 + 2 degree + 1 functions.
inline void sh_basis(const Vec3& direction, int degree, double* basis)
{
    const auto [x, y, z] = direction;
    const double xx = x * x, yy = y * y, zz = z * z;
    basis[0] = SH_C0;
    if (degree < 1)
        return;
    basis[1] = -SH_C1 * y;
    basis[2] = SH_C1 * z;
    basis[3] = -SH_C1 * x;
    if (degree < 2)
        return;
    basis[4] = SH_C2_0 * x * y;
    basis[5] = -SH_C2_0 * y * z;
    basis[6] = SH_C2_1 * (2 * zz - xx - yy);
    basis[7] = -SH_C2_0 * x * z;
    basis[8] = SH_C2_2 * (xx - yy);
    if (degree < 3)
        return;
    basis[9] = -SH_C3_0 * y * (3 * xx - yy);
    basis[10] = SH_C3_1 * x * y * z;
    basis[11] = -SH_C3_2 * y * (4 * zz - xx - yy);
    basis[12] = SH_C3_3 * z * (2 * zz - 3 * xx - 3 * yy);
    basis[13] = -SH_C3_2 * x * (4 * zz - xx - yy);
    basis[14] = SH_C3_4 * z * (xx - yy);
    basis[15] = -SH_C3_0 * x * (xx - 3 * yy);
}

// Gradient of each basis function with respect to the direction.
inline void sh_basis_gradient(const Vec3& direction, int degree, Vec3* gradient)
{
    const auto [x, y, z] = direction;
    const double xx = x * x, yy = y * y, zz = z * z;
    gradient[0] = {0, 0, 0};
    if (degree < 1)
        return;
    gradient[1] = {0, -SH_C1, 0};
    gradient[2] = {0, 0, SH_C1};
    gradient[3] = {-SH_C1, 0, 0};
    if (degree < 2)
        return;
    gradient[4] = SH_C2_0 * Vec3{y, x, 0};
    gradient[5] = -SH_C2_0 * Vec3{0, z, y};
    gradient[6] = SH_C2_1 * Vec3{-2 * x, -2 * y, 4 * z};
    gradient[7] = -SH_C2_0 * Vec3{z, 0, x};
    gradient[8] = SH_C2_2 * Vec3{2 * x, -2 * y, 0};
    if (degree < 3)
        return;
    gradient[9] = -SH_C3_0 * Vec3{6 * x * y, 3 * xx - 3 * yy, 0};
    gradient[10] = SH_C3_1 * Vec3{y * z, x * z, x * y};
    gradient[11] = -SH_C3_2 * Vec3{-2 * x * y, 4 * zz - xx - 3 * yy, 8 * y * z};
    gradient[12] = SH_C3_3 * Vec3{-6 * x * z, -6 * y * z, 6 * zz - 3 * xx - 3 * yy};
    gradient[13] = -SH_C3_2 * Vec3{4 * zz - 3 * xx - yy, -2 * x * y, 8 * x * z};
    gradient[14] = SH_C3_4 * Vec3{2 * x * z, -2 * y * z, xx - yy};
    gradient[15] = -SH_C3_0 * Vec3{3 * xx - 3 * yy, -6 * x * y, 0};
}
