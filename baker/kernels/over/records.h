// Records that the splatting kernels of all instruction sets share: plain data, no code.
#pragma once

#include <cstddef>
#include <cstdint>

#include "lib/constants.glsl"

// The camera looks down -Z; image row 0 is at the top.
struct Camera {
    double rotation[3][3]; // view from world
    double translation[3]; // view from world, m
    double position[3];    // of the eye in world space, m
    double fx, fy, cx, cy; // px
    int width, height;     // px
};

struct Blend {
    double near;      // m; nearer Gaussians are not drawn
    double dilation;  // px^2
    double alpha_min; // smaller contributions are skipped
    double alpha_max;
};

// Arrays of Gaussians. Value is const Real for parameters that are only read, Real for other parameters,
// gradients and moments. Parameters are activated or raw; raw ones have a logarithm as scale, a logit as
// opacity and a quaternion that is not of unit length.
template <class Value> struct GaussianArrays {
    size_t count;    // N
    int degree;      // of the spherical harmonics; K = (degree + 1)^2
    Value* position; // (N, 3) m
    Value* rotation; // (N, 4) xyzw
    Value* scale;    // (N, 3) m
    Value* opacity;  // (N,)
    Value* sh;       // (N, K, 3)

    size_t coefficients() const { return size_t(degree + 1) * (degree + 1); }
};

// alpha = 2^(log2_opacity - u^2 - v^2), where at an offset (dx, dy) from the mean in px
//     u = whiten_x (dx - shear dy),    v = whiten_y dy.
// (u^2 + v^2) ln 2 is 1/2 d^T conic d, but a sum of squares cannot turn negative and does not cancel for
// needle-shaped Gaussians.
template <class Real> struct Footprint {
    double mean_x, mean_y;   // px
    Real whiten_x, whiten_y; // 1/px; sqrt(log2(e) / (2 variance)), of x at fixed y and of y
    Real shear;              // cov_xy / cov_yy
    Real log2_opacity;
    Real colour[3];               // linear RGB
    uint16_t first_row, last_row; // of tiles
};

// A Gaussian that is drawn. Its key first sorts it by depth and then holds the rows of tiles that it touches.
struct Drawn {
    uint32_t key;
    uint32_t gaussian;

    void set_rows(uint32_t first, uint32_t last) { key = first | last << 16; }
    int first_row() const { return int(key & 0xffff); }
    int last_row() const { return int(key >> 16); }
};

// What one tile contributes to the gradient of one Gaussian: sums over pixels, with p = dloss / dln(alpha)
// and (u, v) as in Footprint.
enum Moment { RED, GREEN, BLUE, P, P_U, P_V, P_UU, P_UV, P_VV, WEIGHT, ERROR, MOMENTS };

// A tile: its list of Gaussians, front to back, and its place in the image.
template <class Real> struct Tile {
    const Footprint<Real>* footprints;
    const uint32_t* entries; // indices of Gaussians
    size_t entry_count;
    int left, top;     // px, of the tile's first pixel
    int width, height; // px, of the image
    Real log2_alpha_min, alpha_max;
};

// A range of Gaussians, front to back, and the range of tiles to search for those that they touch.
template <class Real> struct TileSearch {
    const Footprint<Real>* footprints;
    const Drawn* begin;
    const Drawn* end;
    size_t first_tile, last_tile; // [first, last), row by row
    int columns;                  // of tiles in the image
    int width;                    // px, of the image
    double log2_alpha_min;
};

// The pixels of an image, with packed rows.
template <class Value> struct Pixels {
    Value* radiance;      // (height, width, 3)
    Value* transmittance; // (height, width)
};

// Gradients of the loss with respect to the pixels, and the error to sum over them. Null stands for zeros.
template <class Real> struct PixelGradients {
    const Real* by_radiance;      // (height, width, 3), never null
    const Real* by_transmittance; // (height, width)
    const Real* error;            // (height, width)
};

// Where the moments of a tile go: to a list parallel to the tile's entries or, if that is null, directly to
// the sums.
template <class Real> struct MomentOutput {
    Real* by_entry;    // (entries, MOMENTS)
    Real* by_gaussian; // (N, MOMENTS)
};

// A step of Adam (Kingma and Ba 2015), and the statistics for density control.
struct Step {
    GaussianArrays<float> parameters; // raw
    GaussianArrays<float> mean, square;
    int32_t* steps;                                         // (N,) steps that each Gaussian took
    double rates[5];                                        // step sizes, in the order of the arrays
    float *contribution, *error, *radius, *mean2d_gradient; // (N,)
    bool update;                                            // false: write only the statistics
};

constexpr uint32_t NOT_DRAWN = 0xffffffff;

// Fills footprints and keys of the Gaussians in [begin, end). A key is NOT_DRAWN, or the bits of the depth in
// single precision, which sort like the depth itself.
template <class Real>
using Project = void(const GaussianArrays<const Real>&, const Camera&, const Blend&, size_t begin, size_t end,
    Footprint<Real>*, uint32_t* keys);

// The splatting kernels for one precision.
template <class Real> struct SplatKernels {
    Project<Real>* project;
    // Adds the number of Gaussians that touch each tile to counts[tile - first_tile].
    void (*count_tiles)(const TileSearch<Real>&, uint32_t* counts);
    // Writes the Gaussians that touch a tile to entries[next[tile - first_tile]++].
    void (*list_tiles)(const TileSearch<Real>&, uint32_t* next, uint32_t* entries);
    // Writes the tile's pixels; returns the number of pairs of a Gaussian and a pixel that were blended.
    size_t (*blend)(const Tile<Real>&, const Pixels<Real>&);
    // Sums the moments. The pixels are those that `blend` wrote.
    void (*blend_backward)(
        const Tile<Real>&, const Pixels<const Real>&, const PixelGradients<Real>&, const MomentOutput<Real>&);
    // Turns the sums (N, MOMENTS) into gradients. Those of Gaussians that are not drawn are 0.
    void (*gradients)(const GaussianArrays<const Real>&, const Camera&, const Footprint<Real>*,
        const uint32_t* keys, const Real* sums, size_t begin, size_t end, const GaussianArrays<Real>&);
};
