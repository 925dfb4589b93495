// Gaussians to an image, and the gradient of that.
//
// Kerbl et al. 2023. Every output bit is the same for any number of threads and any instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

#include "buffer.h"
#include "over/records.h"
#include "over/sort.h"
#include "over/tiles.h"

// One image and what its gradient needs, in memory that later images use again.
//
// Bytes per Gaussian at most: footprint 48, key 4, order 8, sums 44 (before, the sort's scratch), moments 3,
// list 4: 111. In training there are 56 of parameters (SH degree 0), 112 of Adam's moments, 4 of its steps
// and 16 of statistics: below 300. Per pixel 16, moments 11, lists 24 and their counters 1/2; in training 28
// more for the image and its gradient: below 100.
template <class Real> class Frame {
public:
    // `project` is what turns these arrays into footprints: activated or raw.
    void splat(const GaussianArrays<const Real>&, const Camera&, const Blend&, Project<Real>* project);
    // Sums the moments of every drawn Gaussian.
    void sum_moments(const PixelGradients<Real>&);
    // First Gaussian of which a sum is not finite; -1 if there is none.
    int64_t first_not_finite() const;
    // From sums to gradients.
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
    // Entries of which the moments are held at once, but for a single tile that has more.
    size_t band_limit() const { return count / 16 + size_t(view.width) * view.height / 4; }

    Camera view = {};
    Blend blend = {};
    size_t count = 0, coefficients = 0, drawn_count = 0, pairs = 0;
    Buffer<Footprint<Real>> footprint_buffer; // (N,)
    Buffer<uint32_t> key_buffer;              // (N,)
    Buffer<Drawn> drawn;                      // front to back
    Buffer<std::byte> sum_buffer;             // (N, MOMENTS) Real; before that, the sort's scratch
    TileLists<Real> lists;
    Buffer<Real> moment_buffer; // (entries of a band, MOMENTS)
    Buffer<Real> radiance, transmittance;
};

// Gaussians per parallel step: some 50 us.
constexpr size_t GRAIN = 1024;
