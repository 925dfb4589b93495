#include "dispatch.h"

#include <atomic>
#include <stdexcept>

namespace scalar {
extern const InstructionSet KERNELS;
}
#if defined(__x86_64__)
namespace avx2 {
extern const InstructionSet KERNELS;
}
namespace avx512 {
extern const InstructionSet KERNELS;
}
#endif

std::vector<const InstructionSet*> instruction_sets()
{
    std::vector<const InstructionSet*> sets = {&scalar::KERNELS};
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        sets.push_back(&avx2::KERNELS);
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("fma"))
        sets.push_back(&avx512::KERNELS);
#endif
    return sets;
}

static std::atomic<const InstructionSet*>& current()
{
    static std::atomic<const InstructionSet*> set = instruction_sets().back();
    return set;
}

const InstructionSet& instruction_set()
{
    return *current();
}

void set_instruction_set(const std::string& name)
{
    for (const InstructionSet* set : instruction_sets())
        if (set->name == name) {
            current() = set;
            return;
        }
    throw std::invalid_argument("this processor has no instruction set " + name);
}

template <> const SplatKernels<float>& splat_kernels()
{
    return instruction_set().splat_float;
}

template <> const SplatKernels<double>& splat_kernels()
{
    return instruction_set().splat_double;
}

template <> const FieldKernels<float>& field_kernels()
{
    return instruction_set().field_float;
}

template <> const FieldKernels<double>& field_kernels()
{
    return instruction_set().field_double;
}
