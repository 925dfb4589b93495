// Small vectors and row-major 3 x 3 matrices. Each element has one lane per Gaussian.
#pragma once

#include "simd/lanes.h"

namespace INSTRUCTION_SET {

using Wide = Lanes<double, 8>; // eight Gaussians

struct Vec3 {
    Wide x, y, z;
};

struct Vec4 {
    Wide x, y, z, w;
};

struct Mat3 {
    Vec3 row[3];
};

ALWAYS_INLINE Vec3 broadcast(const double* v)
{
    return {v[0], v[1], v[2]};
}

ALWAYS_INLINE Mat3 broadcast(const double m[3][3])
{
    return {{broadcast(m[0]), broadcast(m[1]), broadcast(m[2])}};
}

ALWAYS_INLINE Wide dot(const Vec3& a, const Vec3& b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

ALWAYS_INLINE Vec3 cross(const Vec3& a, const Vec3& b)
{
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

ALWAYS_INLINE Vec3 operator+(const Vec3& a, const Vec3& b)
{
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}

ALWAYS_INLINE Vec3 operator-(const Vec3& a, const Vec3& b)
{
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}

ALWAYS_INLINE Vec3 operator*(Wide s, const Vec3& a)
{
    return {s * a.x, s * a.y, s * a.z};
}

ALWAYS_INLINE Vec3 operator*(const Mat3& m, const Vec3& v)
{
    return {dot(m.row[0], v), dot(m.row[1], v), dot(m.row[2], v)};
}

// Row vector times matrix: the same as transpose(m) * v.
ALWAYS_INLINE Vec3 operator*(const Vec3& v, const Mat3& m)
{
    return v.x * m.row[0] + v.y * m.row[1] + v.z * m.row[2];
}

ALWAYS_INLINE Vec3 scaled(const Vec3& a, const Vec3& s)
{
    return {a.x * s.x, a.y * s.y, a.z * s.z};
}

} // namespace INSTRUCTION_SET
