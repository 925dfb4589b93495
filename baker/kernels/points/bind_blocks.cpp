#include "arrays.h"
#include "points/blocks.h"

using namespace nb::literals;

static Output<int64_t> blocks(Input<float, -1, 3> position, Input<float, -1, 3> normal, int depth)
{
    const size_t count = position.shape(0);
    require(normal.shape(0) == count, "positions and normals must have the same length");
    require(depth >= 0 && depth < 32 && (depth == 0 || count >> depth), "a leaf would have no point");
    auto number = allocate<int64_t>({count});
    nb::gil_scoped_release unlocked;
    number_blocks(count, position.data(), normal.data(), depth, number.data());
    return number;
}

void bind_blocks(nb::module_& m)
{
    m.def("blocks", blocks, "position"_a.noconvert(), "normal"_a.noconvert(), "depth"_a,
        "Return the leaf (S,) int64 of each point (S, 3) with a unit normal (S, 3) in a k-d tree of `depth` "
        "levels over both. What is not finite counts as 0.");
}
