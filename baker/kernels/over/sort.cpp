#include "over/sort.h"

#include <array>
#include <utility>

static constexpr int DIGIT_BITS = 11, PASSES = 3; // the counters of a pass stay in the L1 cache
static constexpr uint32_t DIGITS = 1u << DIGIT_BITS;

Drawn* sort_by_key(Drawn* items, Drawn* scratch, size_t count)
{
    const auto digit = [](const Drawn& item, int pass) {
        return item.key >> pass * DIGIT_BITS & (DIGITS - 1);
    };
    std::array<std::array<uint32_t, DIGITS>, PASSES> place = {};
    for (size_t i = 0; i < count; ++i)
        for (int pass = 0; pass < PASSES; ++pass)
            ++place[pass][digit(items[i], pass)];
    for (int pass = 0; pass < PASSES; ++pass) {
        uint32_t start = 0;
        for (uint32_t& p : place[pass])
            start += std::exchange(p, start);
        for (size_t i = 0; i < count; ++i)
            scratch[place[pass][digit(items[i], pass)]++] = items[i];
        std::swap(items, scratch);
    }
    return items;
}
