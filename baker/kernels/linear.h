// Vectors and matrices of three, row major, in double precision.
#pragma once

#include <array>
#include <cmath>

using Vec3 = std::array<double, 3>;
using Vec4 = std::array<double, 4>;
using Mat3 = std::array<Vec3, 3>;

inline double dot(const Vec3& a, const Vec3& b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline Vec3 cross(const Vec3& a, const Vec3& b)
{
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline Vec3 operator+(const Vec3& a, const Vec3& b)
{
    return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

inline Vec3 operator-(const Vec3& a, const Vec3& b)
{
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

inline Vec3 operator*(double s, const Vec3& a)
{
    return {s * a[0], s * a[1], s * a[2]};
}

inline Vec3 operator*(const Mat3& m, const Vec3& v)
{
    return {dot(m[0], v), dot(m[1], v), dot(m[2], v)};
}

// Row vector times matrix: the same as transpose(m) * v.
inline Vec3 operator*(const Vec3& v, const Mat3& m)
{
    return v[0] * m[0] + v[1] * m[1] + v[2] * m[2];
}

inline Vec3 scaled(const Vec3& a, const Vec3& s)
{
    return {a[0] * s[0], a[1] * s[1], a[2] * s[2]};
}
