// Gaussians in the order in which they are blended.
#pragma once

#include <cstddef>
#include <cstdint>

// A Gaussian that is drawn. Its key sorts it by depth, and then holds the rows of tiles that it touches.
struct Drawn {
    uint32_t key;
    uint32_t gaussian;

    void set_rows(uint32_t first, uint32_t last) { key = first | last << 16; }
    int first_row() const { return int(key & 0xffff); }
    int last_row() const { return int(key >> 16); }
};

// Sorts by key, equal keys in the order given. `scratch` has room for as many; returns whichever of the two
// arrays holds the result. A radix sort, least significant digit first.
Drawn* sort_by_key(Drawn* items, Drawn* scratch, size_t count);
