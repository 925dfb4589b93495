// Surface points, and the Gaussians that are read at them.
#pragma once

#include <vector>

#include "buffer.h"
#include "surface/field_records.h"

// Points (count, 3) with normals (count, 3), and if not null with what normal maps bend those by (count, 3),
// all copied. If neighbouring points are consecutive, blocks are compact and fewer Gaussians are read without
// effect.
template <class Real> class Field {
public:
    Field(size_t count, const Real* position, const Real* normal, const Real* bend);

    // Lists the Gaussians that would reach each block if they were `margin` times as large. Later calls use
    // these lists.
    void list(const FieldArrays<Real>& gaussians, const FieldBlend& blend, double margin);

    // sums (count, 4): sum w c and sum w of the listed Gaussians, which may have moved a little since.
    void read(const FieldArrays<Real>& gaussians, Real* sums);

    // The pairs of a Gaussian and a point that it would reach if it were `margin` times as large, by Gaussian
    // and then by point: those where one of the point's values (count, 3) lies below `low` or above `high`
    // (N, 3) of the Gaussian.
    std::vector<ReachedPoint> reached(const FieldArrays<Real>& gaussians, const FieldBlend& blend,
        double margin, const Real* values, const Real* low, const Real* high);

    // derivatives (N, FIELD_DERIVATIVES), from the light (count, 3) and 1 / sum w (count,) that follow from
    // `read`, and dloss / dlight (count, 3).
    void backward(const FieldArrays<Real>& gaussians, const Real* light, const Real* by_light,
        const Real* inverse_weight, Real* derivatives);

    // transposed (N, 3 K + slopes): the derivatives by sh and slope of the sum over the points of B . values
    // (count, 3).
    void transposed(
        const FieldArrays<Real>& gaussians, const Real* values, const Real* inverse_weight, Real* transposed);

    // products (N, 3 K + slopes if those are `free`): `transposed` of weights (count,) times B, in half the
    // time. Free slopes are unknowns like the coefficients, relative to the tint; else they scale the
    // constant coefficients.
    void normal(const FieldArrays<Real>& gaussians, const Real* weights, const Real* inverse_weight,
        bool free, Real* products);

    size_t count() const { return points; }
    size_t entry_count() const { return entries.size(); }  // pairs of a Gaussian and a block
    size_t listed() const { return first_row.size() - 1; } // number of Gaussians

private:
    template <class Visit>
    void visit_touched(
        const PreparedGaussian<Real>& gaussian, const FieldBlend& blend, double margin, Visit&& visit) const;
    template <class Body> void for_each_block(const FieldArrays<Real>& gaussians, Body&& body);
    void prepare(const FieldArrays<Real>& gaussians);
    void sum_rows(size_t gaussians, size_t columns, Real* to) const;

    size_t points;
    std::vector<PointBlock<Real>> blocks;
    std::vector<std::vector<Boxes<Real>>> levels; // those of blocks, of 16 blocks, of 256 blocks ...
    FieldBlend blend = {};
    std::vector<size_t> first_row;      // per Gaussian
    std::vector<size_t> first_in_block; // per block
    std::vector<ListEntry> entries;     // grouped by block
    Buffer<PreparedGaussian<Real>> prepared_gaussians;
    Buffer<Real> rows; // what each run of blocks adds for each Gaussian that it lists, grouped by Gaussian
};
