// One register of numbers, with the operations that differ between instruction sets. `Values` are the
// compiler's own vector types, which have built-in arithmetic.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <utility>

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include "simd/inline.h"

namespace INSTRUCTION_SET {

#if defined(__AVX512F__)
constexpr int REGISTER_BYTES = 64;
#elif defined(__AVX2__)
constexpr int REGISTER_BYTES = 32;
#else
constexpr int REGISTER_BYTES = 16;
#endif

template <class T> constexpr int REGISTER_LANES = REGISTER_BYTES / int(sizeof(T));

typedef float Floats __attribute__((vector_size(REGISTER_BYTES)));
typedef double Doubles __attribute__((vector_size(REGISTER_BYTES)));
typedef uint32_t Words __attribute__((vector_size(REGISTER_BYTES)));
typedef uint64_t LongWords __attribute__((vector_size(REGISTER_BYTES)));

template <class T> struct Register;
template <> struct Register<float> {
    using Values = Floats;
    using Bits = Words;
};
template <> struct Register<double> {
    using Values = Doubles;
    using Bits = LongWords;
};

#if defined(__AVX512F__)

template <class T> struct RegisterMask;
template <> struct RegisterMask<float> {
    __mmask16 set;
};
template <> struct RegisterMask<double> {
    __mmask8 set;
};

ALWAYS_INLINE Floats fused(Floats a, Floats b, Floats c)
{
    return _mm512_fmadd_ps(a, b, c);
}
ALWAYS_INLINE Doubles fused(Doubles a, Doubles b, Doubles c)
{
    return _mm512_fmadd_pd(a, b, c);
}
ALWAYS_INLINE Floats root(Floats a)
{
    return _mm512_sqrt_ps(a);
}
ALWAYS_INLINE Doubles root(Doubles a)
{
    return _mm512_sqrt_pd(a);
}
ALWAYS_INLINE RegisterMask<float> less(Floats a, Floats b)
{
    return {_mm512_cmp_ps_mask(a, b, _CMP_LT_OQ)};
}
ALWAYS_INLINE RegisterMask<double> less(Doubles a, Doubles b)
{
    return {_mm512_cmp_pd_mask(a, b, _CMP_LT_OQ)};
}
ALWAYS_INLINE RegisterMask<float> at_most(Floats a, Floats b)
{
    return {_mm512_cmp_ps_mask(a, b, _CMP_LE_OQ)};
}
ALWAYS_INLINE RegisterMask<double> at_most(Doubles a, Doubles b)
{
    return {_mm512_cmp_pd_mask(a, b, _CMP_LE_OQ)};
}
ALWAYS_INLINE Floats choose(RegisterMask<float> m, Floats a, Floats b)
{
    return _mm512_mask_blend_ps(m.set, b, a);
}
ALWAYS_INLINE Doubles choose(RegisterMask<double> m, Doubles a, Doubles b)
{
    return _mm512_mask_blend_pd(m.set, b, a);
}
template <class T> ALWAYS_INLINE RegisterMask<T> both(RegisterMask<T> a, RegisterMask<T> b)
{
    return {decltype(a.set)(a.set & b.set)};
}
template <class T> ALWAYS_INLINE uint32_t bits_of(RegisterMask<T> m)
{
    return m.set;
}

#elif defined(__AVX2__)

template <class T> struct RegisterMask {
    typename Register<T>::Values set; // all ones or all zeros in each lane
};

ALWAYS_INLINE Floats fused(Floats a, Floats b, Floats c)
{
    return _mm256_fmadd_ps(a, b, c);
}
ALWAYS_INLINE Doubles fused(Doubles a, Doubles b, Doubles c)
{
    return _mm256_fmadd_pd(a, b, c);
}
ALWAYS_INLINE Floats root(Floats a)
{
    return _mm256_sqrt_ps(a);
}
ALWAYS_INLINE Doubles root(Doubles a)
{
    return _mm256_sqrt_pd(a);
}
ALWAYS_INLINE RegisterMask<float> less(Floats a, Floats b)
{
    return {_mm256_cmp_ps(a, b, _CMP_LT_OQ)};
}
ALWAYS_INLINE RegisterMask<double> less(Doubles a, Doubles b)
{
    return {_mm256_cmp_pd(a, b, _CMP_LT_OQ)};
}
ALWAYS_INLINE RegisterMask<float> at_most(Floats a, Floats b)
{
    return {_mm256_cmp_ps(a, b, _CMP_LE_OQ)};
}
ALWAYS_INLINE RegisterMask<double> at_most(Doubles a, Doubles b)
{
    return {_mm256_cmp_pd(a, b, _CMP_LE_OQ)};
}
ALWAYS_INLINE Floats choose(RegisterMask<float> m, Floats a, Floats b)
{
    return _mm256_blendv_ps(b, a, m.set);
}
ALWAYS_INLINE Doubles choose(RegisterMask<double> m, Doubles a, Doubles b)
{
    return _mm256_blendv_pd(b, a, m.set);
}
ALWAYS_INLINE RegisterMask<float> both(RegisterMask<float> a, RegisterMask<float> b)
{
    return {_mm256_and_ps(a.set, b.set)};
}
ALWAYS_INLINE RegisterMask<double> both(RegisterMask<double> a, RegisterMask<double> b)
{
    return {_mm256_and_pd(a.set, b.set)};
}
ALWAYS_INLINE uint32_t bits_of(RegisterMask<float> m)
{
    return _mm256_movemask_ps(m.set);
}
ALWAYS_INLINE uint32_t bits_of(RegisterMask<double> m)
{
    return _mm256_movemask_pd(m.set);
}

#else // any processor

template <class T> struct RegisterMask {
    typename Register<T>::Bits set; // all ones or all zeros in each lane
};

template <class Values> ALWAYS_INLINE Values fused(Values a, Values b, Values c)
{
    for (size_t i = 0; i < sizeof(Values) / sizeof(a[0]); ++i)
        a[i] = std::fma(a[i], b[i], c[i]);
    return a;
}
template <class Values> ALWAYS_INLINE Values root(Values a)
{
    for (size_t i = 0; i < sizeof(Values) / sizeof(a[0]); ++i)
        a[i] = std::sqrt(a[i]);
    return a;
}
ALWAYS_INLINE RegisterMask<float> less(Floats a, Floats b)
{
    return {(Words)(a < b)};
}
ALWAYS_INLINE RegisterMask<double> less(Doubles a, Doubles b)
{
    return {(LongWords)(a < b)};
}
ALWAYS_INLINE RegisterMask<float> at_most(Floats a, Floats b)
{
    return {(Words)(a <= b)};
}
ALWAYS_INLINE RegisterMask<double> at_most(Doubles a, Doubles b)
{
    return {(LongWords)(a <= b)};
}
ALWAYS_INLINE Floats choose(RegisterMask<float> m, Floats a, Floats b)
{
    return (Floats)((m.set & (Words)a) | (~m.set & (Words)b));
}
ALWAYS_INLINE Doubles choose(RegisterMask<double> m, Doubles a, Doubles b)
{
    return (Doubles)((m.set & (LongWords)a) | (~m.set & (LongWords)b));
}
template <class T> ALWAYS_INLINE RegisterMask<T> both(RegisterMask<T> a, RegisterMask<T> b)
{
    return {a.set & b.set};
}
template <class T> ALWAYS_INLINE uint32_t bits_of(RegisterMask<T> m)
{
    uint32_t result = 0;
    for (int i = 0; i < REGISTER_LANES<T>; ++i)
        result |= uint32_t(m.set[i] & 1) << i;
    return result;
}

#endif

// Adds adjacent blocks of `Width` lanes in pairs: first those of `a`, then those of `b`.
template <int Width, class Values, size_t... I>
ALWAYS_INLINE Values add_pairs(Values a, Values b, std::index_sequence<I...>)
{
    return __builtin_shufflevector(a, b, int(I / Width * 2 * Width + I % Width)...) +
        __builtin_shufflevector(a, b, int(I / Width * 2 * Width + I % Width + Width)...);
}

// Exchanges the odd blocks of `Width` lanes of `a` and the even ones of `b`.
template <int Width, class Values, size_t... I>
ALWAYS_INLINE void exchange_blocks(Values& a, Values& b, std::index_sequence<I...>)
{
    constexpr auto odd = [](size_t i) { return i / Width % 2 == 1; };
    constexpr int lanes = sizeof...(I);
    const Values even_blocks = __builtin_shufflevector(a, b, (odd(I) ? lanes + int(I) - Width : int(I))...);
    b = __builtin_shufflevector(a, b, (odd(I) ? lanes + int(I) : int(I) + Width)...);
    a = even_blocks;
}

} // namespace INSTRUCTION_SET
