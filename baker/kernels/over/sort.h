// Gaussians in the order in which they are blended.
#pragma once

#include "over/records.h"

// Sorts by key, equal keys in the order given. `scratch` has room for as many; returns whichever of the two
// arrays holds the result. A radix sort, least significant digit first.
Drawn* sort_by_key(Drawn* items, Drawn* scratch, size_t count);
