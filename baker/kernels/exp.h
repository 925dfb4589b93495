// exp for the inner loops: the compiler turns the float version into vector code.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

#if defined(__GNUC__)
#define ALWAYS_INLINE inline __attribute__((always_inline))
#else
#define ALWAYS_INLINE inline
#endif

// exp(x) for x <= 0, relative error 1e-7; x below -87, NaN included, counts as -87, which gives 1.6e-38.
ALWAYS_INLINE float exp_negative(float x)
{
    x = x > -87.0f ? x : -87.0f;
    constexpr float ROUND = 12582912.0f; // 1.5 * 2^23: adding it leaves the nearest integer in the low bits
    const float shifted = x * 1.44269504f + ROUND;
    const float n = shifted - ROUND;
    const float r = (x - n * 0.693359375f) + n * 2.12194440e-4f; // x - n ln 2; the first product is exact
    // Minimax fit of (exp(r) - 1 - r) / r^2 on +-ln(2)/2 (Lawson's iteration); relative error of exp(r) 3e-9.
    float q = 0.00138145985f;
    q = q * r + 0.00836871689f;
    q = q * r + 0.0416683880f;
    q = q * r + 0.166665206f;
    q = q * r + 0.499999934f;
    const float power_of_two = std::bit_cast<float>((std::bit_cast<uint32_t>(shifted) + 127u) << 23);
    return (1.0f + (r + r * r * q)) * power_of_two;
}

ALWAYS_INLINE double exp_negative(double x)
{
    return std::exp(x);
}
