// Gaussians to an image, and the gradient of that.
//
// Kerbl et al. 2023. Every output bit is the same for any number of threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "projection.h"
#include "tiles.h"

// Arrays of activated Gaussians; Value is const Real for parameters, Real for their gradients.
template <class Value> struct GaussianArrays {
    size_t count;    // N
    int degree;      // of the spherical harmonics; K = (degree + 1)^2
    Value* position; // (N, 3)
    Value* rotation; // (N, 4)
    Value* scale;    // (N, 3)
    Value* opacity;  // (N,)
    Value* sh;       // (N, K, 3)
};

// What backward needs to know of forward.
template <class Real> struct Frame {
    Camera camera;
    Blend blend;
    size_t coefficient_count; // N * K, to recognise the Gaussians
    std::vector<Footprint> footprints;
    TileLists lists;
    std::vector<Real> transmittance; // (height, width)
    std::vector<int32_t> last;       // (height, width)
};

// Writes radiance (height, width, 3); the transmittance is in the frame. Memory: about 130 bytes per Gaussian
// and 8 per pair of a Gaussian and a tile that it touches.
template <class Real>
Frame<Real> splat(
    const GaussianArrays<const Real>& gaussians, const Camera& camera, const Blend& blend, Real* radiance);

// Writes the gradient by every parameter from those by radiance (height, width, 3) and transmittance (height,
// width). `gaussians` are those of the frame. Memory: MOMENTS Reals per pair of a Gaussian and a tile.
template <class Real>
void splat_backward(const Frame<Real>& frame, const GaussianArrays<const Real>& gaussians,
    const Real* by_radiance, const Real* by_transmittance, const GaussianArrays<Real>& gradient);
