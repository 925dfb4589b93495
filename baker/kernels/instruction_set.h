// The table of kernels of one instruction set.
#pragma once

#include "loss/loss_records.h"
#include "over/records.h"
#include "surface/field_records.h"

// Everything that is compiled once per instruction set.
struct InstructionSet {
    const char* name;
    SplatKernels<float> splat_float;
    SplatKernels<double> splat_double;
    Project<float>* project_raw;
    // Takes a step on the raw parameters from the sums (N, MOMENTS) and writes the statistics. Returns the
    // first Gaussian with a gradient that is NaN, which is not stepped, or `end`.
    size_t (*step)(const Step&, const Camera&, const Footprint<float>*, const uint32_t* keys,
        const float* sums, size_t begin, size_t end);
    LossBand<float>* loss_float;
    LossBand<double>* loss_double;
    FieldKernels<float> field_float;
    FieldKernels<double> field_double;
};
