// Defines the Python module _kernels.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "arrays.h"
#include "dispatch.h"
#include "parallel.h"

using namespace nb::literals;

void bind_blocks(nb::module_& m);
void bind_field(nb::module_& m);
void bind_loss(nb::module_& m);
void bind_reading(nb::module_& m);
void bind_sh(nb::module_& m);
void bind_splat(nb::module_& m);
void bind_train(nb::module_& m);

static std::vector<std::string> instruction_set_names()
{
    std::vector<std::string> names;
    for (const InstructionSet* set : instruction_sets())
        names.push_back(set->name);
    return names;
}

NB_MODULE(_kernels, m)
{
    m.attr("TILE_SIZE") = TILE_SIZE;
    m.def("set_thread_count", &set_thread_count, "count"_a,
        "Set the number of threads for later calls; 0 means one per core (default).");
    m.def("thread_count", &thread_count);
    m.def("instruction_sets", &instruction_set_names,
        "Names of the instruction sets that this processor supports, slowest first.");
    m.def("set_instruction_set", &set_instruction_set, "name"_a,
        "Select the instruction set for later calls. The default is the fastest.");
    bind_blocks(m);
    bind_field(m);
    bind_loss(m);
    bind_reading(m);
    bind_sh(m);
    bind_splat(m);
    bind_train(m);
}
