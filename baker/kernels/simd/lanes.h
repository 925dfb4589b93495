// N numbers that undergo the same operations: one register, or a tree of halves if registers are narrower.
//
// This is compiled once per instruction set, each time in a separate namespace, so that the linker cannot mix
// them. All instruction sets compute the same bits: only fma() is fused, and sums are trees of fixed shape.
#pragma once

#include <utility>

#include "simd/registers.h"

namespace INSTRUCTION_SET {

constexpr int PREFETCH_AHEAD = 24; // Gaussians; processing one takes about 100 cycles

template <class T, int N, bool Leaf = N == REGISTER_LANES<T>> struct Mask;
template <class T, int N, bool Leaf = N == REGISTER_LANES<T>> struct Lanes;

template <class T, int N> struct Mask<T, N, true> {
    RegisterMask<T> leaf;

    friend ALWAYS_INLINE Mask operator&(Mask a, Mask b) { return {both(a.leaf, b.leaf)}; }
    friend ALWAYS_INLINE uint32_t bits_of(Mask m) { return bits_of(m.leaf); }
};

template <class T, int N> struct Mask<T, N, false> {
    Mask<T, N / 2> low, high;

    friend ALWAYS_INLINE Mask operator&(Mask a, Mask b) { return {a.low & b.low, a.high & b.high}; }
    friend ALWAYS_INLINE uint32_t bits_of(Mask m) { return bits_of(m.low) | bits_of(m.high) << (N / 2); }
};

template <class T, int N> struct Lanes<T, N, true> {
    typename Register<T>::Values leaf;

    Lanes() = default;
    ALWAYS_INLINE Lanes(T all)
        : leaf(typename Register<T>::Values{} + all)
    {
    }
    static ALWAYS_INLINE Lanes of(typename Register<T>::Values values)
    {
        Lanes result;
        result.leaf = values;
        return result;
    }
    static ALWAYS_INLINE Lanes load(const T* from)
    {
        Lanes result;
        std::memcpy(&result.leaf, from, sizeof(result.leaf));
        return result;
    }
    ALWAYS_INLINE void store(T* to) const { std::memcpy(to, &leaf, sizeof(leaf)); }

    friend ALWAYS_INLINE Lanes operator+(Lanes a, Lanes b) { return of(a.leaf + b.leaf); }
    friend ALWAYS_INLINE Lanes operator-(Lanes a, Lanes b) { return of(a.leaf - b.leaf); }
    friend ALWAYS_INLINE Lanes operator*(Lanes a, Lanes b) { return of(a.leaf * b.leaf); }
    friend ALWAYS_INLINE Lanes operator/(Lanes a, Lanes b) { return of(a.leaf / b.leaf); }
    friend ALWAYS_INLINE Mask<T, N> operator<(Lanes a, Lanes b) { return {less(a.leaf, b.leaf)}; }
    friend ALWAYS_INLINE Mask<T, N> operator<=(Lanes a, Lanes b) { return {at_most(a.leaf, b.leaf)}; }
    friend ALWAYS_INLINE Lanes fma(Lanes a, Lanes b, Lanes c) { return of(fused(a.leaf, b.leaf, c.leaf)); }
    friend ALWAYS_INLINE Lanes sqrt(Lanes a) { return of(root(a.leaf)); }
    friend ALWAYS_INLINE Lanes select(Mask<T, N> m, Lanes a, Lanes b)
    {
        return of(choose(m.leaf, a.leaf, b.leaf));
    }
    // a 2^n, where the low bits of `shifted` hold n. Both arguments and the result must be finite.
    friend ALWAYS_INLINE Lanes scale_by_power(Lanes a, Lanes shifted)
    {
        using Bits = typename Register<T>::Bits;
        constexpr int MANTISSA = sizeof(T) == 4 ? 23 : 52;
        return of((typename Register<T>::Values)((Bits)a.leaf + ((Bits)shifted.leaf << MANTISSA)));
    }
    // Mantissa in [1, 2) and exponent of a normal positive number.
    friend ALWAYS_INLINE std::pair<Lanes, Lanes> split(Lanes a)
    {
        static_assert(sizeof(T) == 8);
        using Bits = typename Register<T>::Bits;
        using Values = typename Register<T>::Values;
        const Bits bits = (Bits)a.leaf, magic = (Bits)(Values{} + 4503599627370496.0); // 2^52
        const Values exponent = (Values)(bits >> 52 | magic) - (4503599627370496.0 + 1023);
        return {of((Values)((bits & 0xfffffffffffff) | 0x3ff0000000000000)), of(exponent)};
    }
};

template <class T, int N> struct Lanes<T, N, false> {
    using Half = Lanes<T, N / 2>;
    Half low, high;

    Lanes() = default;
    ALWAYS_INLINE Lanes(Half l, Half h)
        : low(l)
        , high(h)
    {
    }
    ALWAYS_INLINE Lanes(T all)
        : low(all)
        , high(all)
    {
    }
    static ALWAYS_INLINE Lanes load(const T* from) { return {Half::load(from), Half::load(from + N / 2)}; }
    ALWAYS_INLINE void store(T* to) const { low.store(to), high.store(to + N / 2); }

    friend ALWAYS_INLINE Lanes operator+(Lanes a, Lanes b) { return {a.low + b.low, a.high + b.high}; }
    friend ALWAYS_INLINE Lanes operator-(Lanes a, Lanes b) { return {a.low - b.low, a.high - b.high}; }
    friend ALWAYS_INLINE Lanes operator*(Lanes a, Lanes b) { return {a.low * b.low, a.high * b.high}; }
    friend ALWAYS_INLINE Lanes operator/(Lanes a, Lanes b) { return {a.low / b.low, a.high / b.high}; }
    friend ALWAYS_INLINE Mask<T, N> operator<(Lanes a, Lanes b) { return {a.low < b.low, a.high < b.high}; }
    friend ALWAYS_INLINE Mask<T, N> operator<=(Lanes a, Lanes b)
    {
        return {a.low <= b.low, a.high <= b.high};
    }
    friend ALWAYS_INLINE Lanes fma(Lanes a, Lanes b, Lanes c)
    {
        return {fma(a.low, b.low, c.low), fma(a.high, b.high, c.high)};
    }
    friend ALWAYS_INLINE Lanes sqrt(Lanes a) { return {sqrt(a.low), sqrt(a.high)}; }
    friend ALWAYS_INLINE Lanes select(Mask<T, N> m, Lanes a, Lanes b)
    {
        return {select(m.low, a.low, b.low), select(m.high, a.high, b.high)};
    }
    friend ALWAYS_INLINE Lanes scale_by_power(Lanes a, Lanes shifted)
    {
        return {scale_by_power(a.low, shifted.low), scale_by_power(a.high, shifted.high)};
    }
    friend ALWAYS_INLINE std::pair<Lanes, Lanes> split(Lanes a)
    {
        const auto low = split(a.low), high = split(a.high);
        return {{low.first, high.first}, {low.second, high.second}};
    }
};

template <class L> ALWAYS_INLINE L max(L a, L b)
{
    return select(b < a, a, b);
}

template <class L> ALWAYS_INLINE L min(L a, L b)
{
    return select(a < b, a, b);
}

template <class L> ALWAYS_INLINE L absolute(L a)
{
    return max(a, L(0) - a);
}

template <class T, int N> ALWAYS_INLINE Lanes<T, N> clamp(Lanes<T, N> a, T low, T high)
{
    return min(max(a, Lanes<T, N>(low)), Lanes<T, N>(high));
}

// Adds adjacent blocks of `Width` lanes in pairs: first those of `a`, then those of `b`.
template <int Width, class T, int N> ALWAYS_INLINE Lanes<T, N> fold(Lanes<T, N> a, Lanes<T, N> b)
{
    if constexpr (N == REGISTER_LANES<T>)
        return Lanes<T, N>::of(add_pairs<Width>(a.leaf, b.leaf, std::make_index_sequence<N>()));
    else if constexpr (2 * Width == N)
        return {a.low + a.high, b.low + b.high};
    else
        return {fold<Width>(a.low, a.high), fold<Width>(b.low, b.high)};
}

// The sums of 16 vectors of 16 lanes, each added as a tree of the same shape.
template <class T> ALWAYS_INLINE Lanes<T, 16> sums(const Lanes<T, 16>* v)
{
    const auto quarter = [&](int i) { return fold<4>(fold<8>(v[i], v[i + 1]), fold<8>(v[i + 2], v[i + 3])); };
    return fold<1>(fold<2>(quarter(0), quarter(4)), fold<2>(quarter(8), quarter(12)));
}

// Exchanges the odd blocks of `Width` lanes of `a` and the even ones of `b`.
template <int Width, class T, int N> ALWAYS_INLINE void exchange(Lanes<T, N>& a, Lanes<T, N>& b)
{
    if constexpr (N == REGISTER_LANES<T>)
        exchange_blocks<Width>(a.leaf, b.leaf, std::make_index_sequence<N>());
    else if constexpr (2 * Width == N)
        std::swap(a.high, b.low);
    else
        exchange<Width>(a.low, b.low), exchange<Width>(a.high, b.high);
}

template <int Width = 8, class T> ALWAYS_INLINE void transpose(Lanes<T, 16>* v)
{
    for (int i = 0; i < 16; ++i)
        if (!(i & Width))
            exchange<Width>(v[i], v[i + Width]);
    if constexpr (Width > 1)
        transpose<Width / 2>(v);
}

// Prefetches a value, which may straddle two cache lines.
template <class Value> ALWAYS_INLINE void prefetch(const Value& value)
{
    __builtin_prefetch(&value);
    __builtin_prefetch(reinterpret_cast<const char*>(&value + 1) - 1);
}

} // namespace INSTRUCTION_SET
