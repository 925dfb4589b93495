// Records of reading Gaussians at surface points, the `surface` operator: plain data, no code.
#pragma once

#include <cstddef>
#include <cstdint>

constexpr int FIELD_LANES = 16; // points that are read together
constexpr int FIELD_SH_MAX = 9; // coefficients

// Sums over the points that a Gaussian reaches, with p = dloss / dw, g = p dw / dG G, h = p dw / d(n . n_i)
// and share = w / sum w: of g e (x, y, z); g e e^T (xx, xy, xz, yy, yz, zz); p w; h n (x, y in the Gaussian's
// axes); share dloss / dB (red, green, blue); share error.
constexpr int FIELD_MOMENTS = 16;

// Activated Gaussians; coefficients of K = 1, 4 or 9 spherical harmonics of the normal.
template <class Real> struct FieldArrays {
    size_t count;         // N
    size_t coefficients;  // K
    const Real* position; // (N, 3) m
    const Real* rotation; // (N, 4) xyzw, unit
    const Real* scale;    // (N, 3) m
    const Real* opacity;  // (N,)
    const Real* sh;       // (N, K, 3)
};

// weight = opacity max(0, exp(-q / 2) - cutoff) max(0, n . n_i)^sharpness; with sharpness 0 no factor of n.
struct FieldBlend {
    double cutoff;
    int sharpness;
};

// One Gaussian, ready to be read: e = inverse_scale (axes (x - position)), q = e . e.
template <class Real> struct PreparedGaussian {
    Real position[3];
    Real axes[3][3]; // rows: the ellipsoid's axes, unit; the last is the Gaussian's normal
    Real inverse_scale[3];
    Real opacity;
};

// Points that lie together, one per lane; those that fill up the last block have normal 0.
template <class Real> struct PointBlock {
    alignas(64) Real position[3][FIELD_LANES];
    alignas(64) Real normal[3][FIELD_LANES];
};

// Around points, m.
struct Box {
    float low[3], high[3];
};

// A Gaussian that reaches a block, and its place in the list by Gaussian.
struct ListEntry {
    uint32_t gaussian;
    uint32_t entry;
};

// A block and the Gaussians to be read there.
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
    // Whether a Gaussian weighs anything at some point of a block, were it `margin` times as large.
    bool (*touches)(const PreparedGaussian<Real>&, const PointBlock<Real>&, const FieldBlend&, double margin);
    // Writes sums (lanes, 4) of w c and w.
    void (*read)(const BlockReading<Real>&, Real* sums);
    // Writes moments[entry] (FIELD_MOMENTS) from B and dloss / dB (lanes, 3), 1 / sum w and error (lanes,).
    void (*read_backward)(const BlockReading<Real>&, const Real* light, const Real* by_light,
        const Real* inverse_weight, const Real* error, Real* moments);
    // Writes transposed[entry] (K, 3), the sums over the lanes of share Y_k(n) values (lanes, 3).
    void (*transposed)(
        const BlockReading<Real>&, const Real* values, const Real* inverse_weight, Real* transposed);
};
