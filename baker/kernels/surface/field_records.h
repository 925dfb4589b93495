// Records for reading Gaussians at surface points (the `surface` operator): plain data, no code.
#pragma once

#include <cstddef>
#include <cstdint>

constexpr int FIELD_LANES = 16; // points read together
constexpr int FIELD_SH_MAX = 9; // SH coefficients
constexpr int FIELD_KEPT = 4;   // numbers per lane and Gaussian that a product keeps between its two halves

// A Gaussian's derivatives of the loss, in this order: place u (3), which moves the centre by R S u; turn
// (3), a rotation vector in the Gaussian's own axes; log_scale (3); logit_opacity; the constant coefficient
// (3); slope (2).
constexpr int FIELD_DERIVATIVES = 15;

// From one row of `columns` numbers to the next.
constexpr size_t field_stride(size_t columns)
{
    return (columns + FIELD_LANES - 1) / FIELD_LANES * FIELD_LANES;
}

// Activated Gaussians, with coefficients of K = 1, 4 or 9 spherical harmonics of the normal, or of the K = 3
// coordinates of its bend. With e the
// offset of a point from the centre along the Gaussian's axes, in standard deviations, the light there is c =
// sum sh_k Y_k(n) + Y_0 tint (slope . e), where the tint of a Gaussian is its constant coefficient sh_0, so
// that slopes are relative to that. With the tint held, the light is linear in sh and slope.
template <class Real> struct FieldArrays {
    size_t count;         // N
    size_t coefficients;  // K
    size_t slopes;        // 0 or 2
    const Real* position; // (N, 3) m
    const Real* rotation; // (N, 4) xyzw, unit
    const Real* scale;    // (N, 3) m
    const Real* opacity;  // (N,)
    const Real* sh;       // (N, K, 3)
    const Real* slope;    // (N, slopes)
    const Real* tint;     // first of 3 coefficients, of each Gaussian
    size_t tint_stride;   // from those of one Gaussian to those of the next
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
    Real tint[3];  // Y_0 times that of FieldArrays
    Real slope[2]; // 0 for Gaussians without
};

// Consecutive points, one per lane. Unused lanes of the last block have normal 0. The bend is what normal
// maps add to the normal.
template <class Real> struct PointBlock {
    alignas(64) Real position[3][FIELD_LANES];
    alignas(64) Real normal[3][FIELD_LANES];
    alignas(64) Real bend[3][FIELD_LANES];
};

// Bounding boxes, m, of blocks or of other boxes, one per lane. Those of unused lanes hold nothing.
template <class Real> struct Boxes {
    alignas(64) Real low[3][FIELD_LANES];
    alignas(64) Real high[3][FIELD_LANES];
};

// A Gaussian that reaches a block, and the row to which the block adds what it computes for that Gaussian.
// The blocks of a run share the row; the `first` of them to be read sets it.
struct ListEntry {
    uint32_t gaussian;
    uint32_t row : 31, first : 1;
};

// A Gaussian, and a point that it reaches.
struct ReachedPoint {
    uint32_t gaussian;
    uint32_t point;
};

// A block of points and the Gaussians to read there.
template <class Real> struct BlockReading {
    const PointBlock<Real>* points;
    const ListEntry* list;
    size_t list_length;
    const PreparedGaussian<Real>* gaussians;
    const Real* sh; // (N, K, 3)
    size_t coefficients, slopes;
    FieldBlend blend;
};

template <class Real> struct FieldKernels {
    // The lanes, as bits, of the boxes that overlap that from `low` (3,) to `high` (3,).
    uint32_t (*overlaps)(const Boxes<Real>&, const Real* low, const Real* high);
    // The lanes, as bits, of a block's points at which a Gaussian has any weight.
    uint32_t (*touches)(const PreparedGaussian<Real>&, const PointBlock<Real>&, const FieldBlend&);
    // Writes sums (lanes, 4) of w c and w.
    void (*read)(const BlockReading<Real>&, Real* sums);
    // The next three add to the rows of the list's Gaussians, which are field_stride() apart.
    // derivatives (FIELD_DERIVATIVES) follow from B and dloss / dB (lanes, 3) and 1 / sum w (lanes,).
    void (*read_backward)(const BlockReading<Real>&, const Real* light, const Real* by_light,
        const Real* inverse_weight, Real* derivatives);
    // transposed (3 K + slopes) are the derivatives by sh and slope of the sum over the lanes of B . values
    // (lanes, 3).
    void (*transposed)(
        const BlockReading<Real>&, const Real* values, const Real* inverse_weight, Real* transposed);
    // products (3 K + slopes if those are `free`) are `transposed` of the lanes' weights (lanes,) times B.
    // Slopes that are free are 0 there, and else they scale the constant coefficient. `kept` has room for
    // FIELD_KEPT numbers per lane and entry of the list.
    void (*normal)(const BlockReading<Real>&, const Real* weights, const Real* inverse_weight, bool free,
        Real* kept, Real* products);
    // Writes the sums (columns,) of consecutive rows, added in double precision and in their order.
    void (*sum_rows)(const Real* rows, size_t count, size_t columns, Real* sums);
};
