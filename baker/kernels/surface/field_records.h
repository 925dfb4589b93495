// Records for reading Gaussians at surface points (the `surface` operator): plain data, no code.
#pragma once

#include <cstddef>
#include <cstdint>

constexpr int FIELD_LANES = 16; // points read together
constexpr int FIELD_SH_MAX = 9; // SH coefficients

// Number of sums over the points that a Gaussian reaches. With e the offset of the point from the centre
// along the Gaussian's axes, in standard deviations, n the normal there, G = exp(-e^2 / 2), p = dloss / dw,
// g = p G dw / dG, h = p dw / d(n . n_i) and share = w / sum w, they are the sums of g e (x, y, z); g e e^T
// (xx, xy, xz, yy, yz, zz); p w; h n (x, y in the Gaussian's axes); share dloss / dB (red, green, blue);
// share error.
constexpr int FIELD_MOMENTS = 16;

// Activated Gaussians, with coefficients of K = 1, 4 or 9 spherical harmonics of the normal.
template <class Real> struct FieldArrays {
    size_t count;         // N
    size_t coefficients;  // K
    const Real* position; // (N, 3) m
    const Real* rotation; // (N, 4) xyzw, unit
    const Real* scale;    // (N, 3) m
    const Real* opacity;  // (N,)
    const Real* sh;       // (N, K, 3)
};

// weight = opacity max(0, exp(-q / 2) - cutoff) max(0, n . n_i)^sharpness, without the last factor if
// sharpness is 0.
struct FieldBlend {
    double cutoff;
    int sharpness;
};

// One Gaussian, prepared for reading at a point x: e = inverse_scale (axes (x - position)), q = e . e.
template <class Real> struct PreparedGaussian {
    Real position[3];
    Real axes[3][3]; // rows: the ellipsoid's unit axes; the last is the Gaussian's normal
    Real inverse_scale[3];
    Real opacity;
};

// Consecutive points, one per lane. Unused lanes of the last block have normal 0.
template <class Real> struct PointBlock {
    alignas(64) Real position[3][FIELD_LANES];
    alignas(64) Real normal[3][FIELD_LANES];
};

// Bounding box of points, m.
struct Box {
    float low[3], high[3];
};

// A Gaussian that reaches a block, and the pair's index in the list grouped by Gaussian.
struct ListEntry {
    uint32_t gaussian;
    uint32_t entry;
};

// A block of points and the Gaussians to read there.
template <class Real> struct BlockReading {
    const PointBlock<Real>* points;
    const ListEntry* list;
    size_t list_length;
    const PreparedGaussian<Real>* gaussians;
    const Real* sh; // (N, K, 3)
    size_t coefficients;
    FieldBlend blend;
};

template <class Real> struct FieldKernels {
    // Whether a Gaussian would have any weight at a point of a block if it were `margin` times as large.
    bool (*touches)(const PreparedGaussian<Real>&, const PointBlock<Real>&, const FieldBlend&, double margin);
    // Writes sums (lanes, 4) of w c and w.
    void (*read)(const BlockReading<Real>&, Real* sums);
    // Writes moments[entry] (FIELD_MOMENTS) from B and dloss / dB (lanes, 3), 1 / sum w and error (lanes,).
    void (*read_backward)(const BlockReading<Real>&, const Real* light, const Real* by_light,
        const Real* inverse_weight, const Real* error, Real* moments);
    // Writes transposed[entry] (K, 3), the sum over the lanes of share Y_k(n) values (lanes, 3).
    void (*transposed)(
        const BlockReading<Real>&, const Real* values, const Real* inverse_weight, Real* transposed);
};
