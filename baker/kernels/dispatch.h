// Selects the instruction set at run time: the fastest that the processor supports, or the requested one.
#pragma once

#include <string>
#include <vector>

#include "instruction_set.h"

// The instruction sets that this processor supports, slowest first.
std::vector<const InstructionSet*> instruction_sets();

// The instruction set in use.
const InstructionSet& instruction_set();

// Throws std::invalid_argument if the processor supports no instruction set of this name.
void set_instruction_set(const std::string& name);

template <class Real> const SplatKernels<Real>& splat_kernels();
template <> const SplatKernels<float>& splat_kernels();
template <> const SplatKernels<double>& splat_kernels();

template <class Real> const FieldKernels<Real>& field_kernels();
template <> const FieldKernels<float>& field_kernels();
template <> const FieldKernels<double>& field_kernels();
