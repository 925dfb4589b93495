#include "sort.h"

#include <algorithm>
#include <array>
#include <utility>

static constexpr int DIGIT_BITS = 11; // three passes; the counters of one stay in the L1 cache
static constexpr uint32_t DIGITS = 1u << DIGIT_BITS;

Drawn* sort_by_key(Drawn* items, Drawn* scratch, size_t count)
{
    for (int shift = 0; shift < 32; shift += DIGIT_BITS) {
        const auto digit = [&](const Drawn& item) { return item.key >> shift & (DIGITS - 1); };
        std::array<size_t, DIGITS> place = {};
        for (size_t i = 0; i < count; ++i)
            ++place[digit(items[i])];
        size_t start = 0;
        for (size_t& p : place)
            start += std::exchange(p, start);
        for (size_t i = 0; i < count; ++i)
            scratch[place[digit(items[i])]++] = items[i];
        std::swap(items, scratch);
    }
    return items;
}
