// Sorts Gaussians into the order in which they are blended.
#pragma once

#include "over/records.h"

// Sorts by key; equal keys keep their order. `scratch` must have room for `count` items. Returns `items` or
// `scratch`, the one that holds the result. This is a radix sort, least significant digit first.
Drawn* sort_by_key(Drawn* items, Drawn* scratch, size_t count);
