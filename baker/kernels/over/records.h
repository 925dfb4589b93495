// What the kernels that splat share, whatever the instruction set: plain data, no code.
#pragma once

#include <cstddef>
#include <cstdint>

#include "lib/constants.glsl"

// Space: the camera looks down -Z, image row 0 on top.
struct Camera {
    double rotation[3][3]; // view from world
    double translation[3]; // view from world, m
    double position[3];    // of the eye in the world, m
    double fx, fy, cx, cy; // px
    int width, height;     // px
};

struct Blend {
    double near;      // m; nearer Gaussians are not drawn
    double dilation;  // px^2
    double alpha_min; // smaller contributions are skipped
    double alpha_max;
};

// Arrays of Gaussians: const Real for parameters, Real for gradients and moments. Activated, or raw: scale is
// then a logarithm, opacity a logit, and the quaternion not of unit length.
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

// alpha = 2^(log2_opacity - u^2 - v^2) with, at an offset (dx, dy) from the mean in px,
//     u = whiten_x (dx - shear dy),    v = whiten_y dy.
// The same as -1/2 d^T conic d, but a sum of squares: it cannot turn positive, and a needle does not cancel.
template <class Real> struct Footprint {
    double mean_x, mean_y;   // px
    Real whiten_x, whiten_y; // 1/px; sqrt(log2(e) / (2 variance)) of x at fixed y, and of y
    Real shear;              // cov_xy / cov_yy
    Real log2_opacity;
    Real colour[3];               // linear RGB
    uint16_t first_row, last_row; // of tiles
};

// A Gaussian that is drawn. Its key sorts it by depth, and then holds the rows of tiles that it touches.
struct Drawn {
    uint32_t key;
    uint32_t gaussian;

    void set_rows(uint32_t first, uint32_t last) { key = first | last << 16; }
    int first_row() const { return int(key & 0xffff); }
    int last_row() const { return int(key >> 16); }
};

// What one Gaussian adds to its gradient in one tile: sums over pixels. With p = dloss / dln(alpha), (u, v)
// as above:
enum Moment { RED, GREEN, BLUE, P, P_U, P_V, P_UU, P_UV, P_VV, WEIGHT, ERROR, MOMENTS };

// The tile's list of Gaussians, front to back, and where it lies.
template <class Real> struct Tile {
    const Footprint<Real>* footprints;
    const uint32_t* entries; // Gaussians
    size_t entry_count;
    int left, top;     // px, of the tile's first pixel
    int width, height; // px, of the image
    Real log2_alpha_min, alpha_max;
};

// Some Gaussians, front to back, and the tiles among which those that they touch are looked for.
template <class Real> struct TileSearch {
    const Footprint<Real>* footprints;
    const Drawn* begin;
    const Drawn* end;
    size_t first_tile, last_tile; // [first, last), in rows
    int columns;                  // of tiles in the image
    int width;                    // px, of the image
    double log2_alpha_min;
};

// Light of the pixels of an image; rows packed.
template <class Value> struct Pixels {
    Value* radiance;      // (height, width, 3)
    Value* transmittance; // (height, width)
};

// Gradients of the loss by the pixels, and what else is summed over them; null stands for zeros.
template <class Real> struct PixelGradients {
    const Real* by_radiance;      // (height, width, 3), never null
    const Real* by_transmittance; // (height, width)
    const Real* error;            // (height, width)
};

// Where the moments of a tile go: to a list parallel to the tile's, or, where that is null, straight onto the
// sums.
template <class Real> struct MomentOutput {
    Real* by_entry;    // (entries, MOMENTS)
    Real* by_gaussian; // (N, MOMENTS)
};

// Adam's steps (Kingma and Ba 2015), and what density control needs to know.
struct Step {
    GaussianArrays<float> parameters; // raw
    GaussianArrays<float> mean, square;
    int32_t* steps;                                         // (N,) that each Gaussian took
    double rates[5];                                        // in the order of the arrays
    float *contribution, *error, *radius, *mean2d_gradient; // (N,)
    bool update;                                            // false: the statistics alone
};

constexpr uint32_t NOT_DRAWN = 0xffffffff;

// Fills footprints and keys, the bits of the depth in single precision, which sort like numbers, or
// NOT_DRAWN; for the Gaussians in [begin, end).
template <class Real>
using Project = void(const GaussianArrays<const Real>&, const Camera&, const Blend&, size_t begin, size_t end,
    Footprint<Real>*, uint32_t* keys);

// How to splat in one precision.
template <class Real> struct SplatKernels {
    Project<Real>* project;
    // Adds to counts[tile - first_tile] how many Gaussians touch each tile.
    void (*count_tiles)(const TileSearch<Real>&, uint32_t* counts);
    // Writes the Gaussians that touch a tile to entries[next[tile - first_tile]++].
    void (*list_tiles)(const TileSearch<Real>&, uint32_t* next, uint32_t* entries);
    // Writes the tile's pixels; returns how many pairs of a Gaussian and a pixel were blended.
    size_t (*blend)(const Tile<Real>&, const Pixels<Real>&);
    // Sums moments; the pixels are those that blend wrote.
    void (*blend_backward)(
        const Tile<Real>&, const Pixels<const Real>&, const PixelGradients<Real>&, const MomentOutput<Real>&);
    // From the sums (N, MOMENTS) to gradients; those of Gaussians that are not drawn are 0.
    void (*gradients)(const GaussianArrays<const Real>&, const Camera&, const Footprint<Real>*,
        const uint32_t* keys, const Real* sums, size_t begin, size_t end, const GaussianArrays<Real>&);
};
