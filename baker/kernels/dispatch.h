// Which instruction set computes: the best that the processor has, or the one that was asked for.
#pragma once

#include <string>
#include <vector>

#include "instruction_set.h"

// Those that this processor can run, slowest first.
std::vector<const InstructionSet*> instruction_sets();

// The one in use.
const InstructionSet& instruction_set();

// Throws std::invalid_argument where the processor has none of this name.
void set_instruction_set(const std::string& name);

template <class Real> const SplatKernels<Real>& splat_kernels();
template <> const SplatKernels<float>& splat_kernels();
template <> const SplatKernels<double>& splat_kernels();

template <class Real> const FieldKernels<Real>& field_kernels();
template <> const FieldKernels<float>& field_kernels();
template <> const FieldKernels<double>& field_kernels();
