// Powers of 2 and base-2 logarithms of lanes.
#pragma once

#include "simd/lanes.h"

namespace INSTRUCTION_SET {

// 2^x with a relative error of 2e-7 for x in [-126, 127]; an arbitrary result, but no trap, elsewhere.
template <int N> ALWAYS_INLINE Lanes<float, N> exp2(Lanes<float, N> x)
{
    using L = Lanes<float, N>;
    const L shifted = x + L(12582912.0f); // 1.5 * 2^23 puts the nearest integer into the low bits
    const L r = x - (shifted - L(12582912.0f));
    // Minimax fit of 2^r on [-1/2, 1/2] (Lawson's iteration) with a relative error of 9e-8.
    L q = fma(r, L(0.001326472731f), L(0.009671512991f));
    q = fma(r, q, L(0.05550733581f));
    q = fma(r, q, L(0.2402224243f));
    q = fma(r, q, L(0.6931470037f));
    return scale_by_power(fma(r, q, L(1)), shifted);
}

// 2^x with a relative error of 1e-15 for x in [-1022, 1023]; an arbitrary result, but no trap, elsewhere.
template <int N> ALWAYS_INLINE Lanes<double, N> exp2(Lanes<double, N> x)
{
    using L = Lanes<double, N>;
    const L shifted = x + L(6755399441055744.0); // 1.5 * 2^52
    const L r = (x - (shifted - L(6755399441055744.0))) * L(0.6931471805599453);
    L q = 1 / 6227020800.0; // Taylor series with remainder 0.3466^14 / 14! = 4e-18
    constexpr double FACTORIALS[] = {
        479001600, 39916800, 3628800, 362880, 40320, 5040, 720, 120, 24, 6, 2, 1, 1};
    for (double factorial : FACTORIALS)
        q = fma(q, r, L(1 / factorial));
    return scale_by_power(q, shifted);
}

// log2(x) for normal x > 0, with a relative error of 1e-15 away from x = 1.
template <int N> ALWAYS_INLINE Lanes<double, N> log2(Lanes<double, N> x)
{
    using L = Lanes<double, N>;
    const auto [mantissa, exponent] = split(x); // mantissa in [1, 2)
    const auto upper = L(1.4) < mantissa;
    const L m = select(upper, mantissa * L(0.5), mantissa), e = select(upper, exponent + L(1), exponent);
    // ln m = 2 artanh(s) with |s| <= 0.18; the first omitted term is 0.18^25 / 25 = 1e-20.
    const L s = (m - L(1)) / (m + L(1)), ss = s * s;
    L q = 1 / 23.0;
    for (int k = 21; k > 0; k -= 2)
        q = fma(q, ss, L(1.0 / k));
    return fma(s * q, L(2 * 1.4426950408889634), e);
}

} // namespace INSTRUCTION_SET
