// Blocks of neighbours: the leaves of a k-d tree.
#pragma once

#include <cstddef>
#include <cstdint>

// Writes to `number` (count) the leaf of each point, numbered from left to right, of a k-d tree of `depth`
// levels (Bentley 1975) over positions (count, 3) and unit normals (count, 3). Each node is divided in half
// along the axis on which its points spread most; a turn counts as much as a step across all of them. Where
// points are equal along it, the next widest decides. What is not finite counts as 0.
void number_blocks(size_t count, const float* position, const float* normal, int depth, int64_t* number);
