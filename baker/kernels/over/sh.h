// Real spherical harmonics up to degree 3 and their derivatives.
//
// Orthonormal, with the Condon-Shortley phase, as in Kerbl et al. 2023. The direction is a unit vector. The
// derivatives are those of the polynomials as written, so the caller must project them onto the sphere.
#pragma once

#include "lib/constants.glsl"
#include "simd/linear.h"

namespace INSTRUCTION_SET {

constexpr int SH_MAX = 16;

// Values of the (degree + 1)^2 basis functions.
inline void sh_basis(const Vec3& direction, int degree, Wide* basis)
{
    const auto [x, y, z] = direction;
    const Wide xx = x * x, yy = y * y, zz = z * z, two = 2, three = 3, four = 4;
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
    basis[6] = SH_C2_1 * (two * zz - xx - yy);
    basis[7] = -SH_C2_0 * x * z;
    basis[8] = SH_C2_2 * (xx - yy);
    if (degree < 3)
        return;
    basis[9] = -SH_C3_0 * y * (three * xx - yy);
    basis[10] = SH_C3_1 * x * y * z;
    basis[11] = -SH_C3_2 * y * (four * zz - xx - yy);
    basis[12] = SH_C3_3 * z * (two * zz - three * xx - three * yy);
    basis[13] = -SH_C3_2 * x * (four * zz - xx - yy);
    basis[14] = SH_C3_4 * z * (xx - yy);
    basis[15] = -SH_C3_0 * x * (xx - three * yy);
}

// Gradient of each basis function with respect to the direction.
inline void sh_basis_gradient(const Vec3& direction, int degree, Vec3* gradient)
{
    const auto [x, y, z] = direction;
    const Wide xx = x * x, yy = y * y, zz = z * z, zero = 0, two = 2, three = 3, four = 4, six = 6, eight = 8;
    gradient[0] = {zero, zero, zero};
    if (degree < 1)
        return;
    gradient[1] = {zero, -SH_C1, zero};
    gradient[2] = {zero, zero, SH_C1};
    gradient[3] = {-SH_C1, zero, zero};
    if (degree < 2)
        return;
    gradient[4] = SH_C2_0 * Vec3{y, x, zero};
    gradient[5] = -SH_C2_0 * Vec3{zero, z, y};
    gradient[6] = SH_C2_1 * Vec3{-2.0 * x, -2.0 * y, four * z};
    gradient[7] = -SH_C2_0 * Vec3{z, zero, x};
    gradient[8] = SH_C2_2 * Vec3{two * x, -2.0 * y, zero};
    if (degree < 3)
        return;
    gradient[9] = -SH_C3_0 * Vec3{six * x * y, three * xx - three * yy, zero};
    gradient[10] = SH_C3_1 * Vec3{y * z, x * z, x * y};
    gradient[11] = -SH_C3_2 * Vec3{-2.0 * x * y, four * zz - xx - three * yy, eight * y * z};
    gradient[12] = SH_C3_3 * Vec3{-6.0 * x * z, -6.0 * y * z, six * zz - three * xx - three * yy};
    gradient[13] = -SH_C3_2 * Vec3{four * zz - three * xx - yy, -2.0 * x * y, eight * x * z};
    gradient[14] = SH_C3_4 * Vec3{two * x * z, -2.0 * y * z, xx - yy};
    gradient[15] = -SH_C3_0 * Vec3{three * xx - three * yy, -6.0 * x * y, zero};
}

} // namespace INSTRUCTION_SET
