// Python bindings of the spherical harmonics.
#include "arrays.h"
#include "over/sh.h"

using namespace nb::literals;

static Output<double> sh_basis_of(Input<double, -1, 3> direction, int degree)
{
    require(0 <= degree && degree <= 3, "degree must be 0 to 3");
    using namespace INSTRUCTION_SET;
    const size_t count = direction.shape(0), k = size_t(degree + 1) * (degree + 1);
    auto basis = allocate<double>({count, k});
    for (size_t i = 0; i < count; ++i) {
        Wide values[SH_MAX];
        sh_basis({direction(i, 0), direction(i, 1), direction(i, 2)}, degree, values);
        for (size_t c = 0; c < k; ++c) {
            double lanes[8];
            values[c].store(lanes);
            basis.data()[i * k + c] = lanes[0];
        }
    }
    return basis;
}

void bind_sh(nb::module_& m)
{
    m.def("sh_basis", &sh_basis_of, "direction"_a.noconvert(), "degree"_a,
        "Return the basis functions (M, K) float64 at unit vectors (M, 3).");
}
