// Renders Gaussians to an image, and computes the gradient of that.
//
// Kerbl et al. 2023. Outputs are bit-identical for any number of threads and any instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

#include "buffer.h"
#include "over/records.h"
#include "over/sort.h"
#include "over/tiles.h"

// One image and the data that its gradient needs. Later images reuse the memory.
//
// Bytes per Gaussian, at most: footprint 48, key 4, order 8, sums 44 (first used as the sort's scratch),
// moments 3, list 4; in total 111. Training adds 56 for the parameters (SH degree 0), 112 for Adam's moments,
// 4 for its step counts and 16 for statistics; the total is below 300. Bytes per pixel: image and
// transmittance 16, moments 11, lists 24, their counters 1/2. Training adds 28 for the image and its
// gradient; the total is below 100.
template <class Real> class Frame {
public:
    // `project` turns these arrays, which are activated or raw, into footprints.
    void splat(const GaussianArrays<const Real>&, const Camera&, const Blend&, Project<Real>* project);
    // Sums the moments of every drawn Gaussian.
    void sum_moments(const PixelGradients<Real>&);
    // Index of the first Gaussian with a sum that is not finite; -1 if there is none.
    int64_t first_not_finite() const;
    // Turns the sums into gradients.
    void gradients(const GaussianArrays<const Real>&, const GaussianArrays<Real>&) const;

    bool is_of(const GaussianArrays<const Real>&) const;
    Pixels<const Real> pixels() const { return {radiance.get(), transmittance.get()}; }
    const Camera& camera() const { return view; }
    const Footprint<Real>* footprints() const { return footprint_buffer.get(); }
    const uint32_t* keys() const { return key_buffer.get(); }
    const Real* sums() const { return reinterpret_cast<const Real*>(sum_buffer.get()); }
    size_t pair_count() const { return pairs; }
    size_t entry_count() const { return lists.entry_count(); }
    size_t byte_count() const;

private:
    void order(const Real* position);
    Tile<Real> tile_of(size_t index) const;
    void add_moments(const Band&);
    // Largest number of entries whose moments are held at once. A tile with more is a band of its own.
    size_t band_limit() const { return count / 16 + size_t(view.width) * view.height / 4; }

    Camera view = {};
    Blend blend = {};
    size_t count = 0, coefficients = 0, drawn_count = 0, pairs = 0;
    Buffer<Footprint<Real>> footprint_buffer; // (N,)
    Buffer<uint32_t> key_buffer;              // (N,)
    Buffer<Drawn> drawn;                      // front to back
    Buffer<std::byte> sum_buffer;             // (N, MOMENTS) Real; first used as the sort's scratch
    TileLists<Real> lists;
    Buffer<Real> moment_buffer; // (entries of a band, MOMENTS)
    Buffer<Real> radiance, transmittance;
};

// Gaussians per chunk of a parallel loop: about 50 us of work.
constexpr size_t GRAIN = 1024;
