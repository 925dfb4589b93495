#include "tiles.h"

#include <functional>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

static std::vector<size_t> running_sum(const std::vector<uint32_t>& counts)
{
    std::vector<size_t> start(counts.size() + 1, 0);
    std::inclusive_scan(counts.begin(), counts.end(), start.begin() + 1, std::plus<>(), size_t(0));
    return start;
}

static std::vector<uint32_t> front_to_back(
    const std::vector<Footprint>& footprints, const std::vector<uint32_t>& tile_count)
{
    std::vector<std::pair<double, uint32_t>> keys;
    for (uint32_t i = 0; i < footprints.size(); ++i)
        if (tile_count[i] > 0)
            keys.emplace_back(footprints[i].depth, i);
    std::sort(keys.begin(), keys.end());

    std::vector<uint32_t> order;
    order.reserve(keys.size());
    for (const auto& key : keys)
        order.push_back(key.second);
    return order;
}

TileLists list_tiles(
    const std::vector<Footprint>& footprints, const std::vector<uint32_t>& tile_count, const TileGrid& grid)
{
    TileLists lists;
    lists.slot_start = running_sum(tile_count);
    if (lists.slot_start.back() > std::numeric_limits<uint32_t>::max())
        throw std::length_error("more than 2^32 pairs of a Gaussian and a tile");

    const std::vector<uint32_t> order = front_to_back(footprints, tile_count);
    std::vector<uint32_t> entry_count(grid.count(), 0);
    for (uint32_t gaussian : order)
        for_each_tile(footprints[gaussian], grid, [&](size_t tile) { ++entry_count[tile]; });
    lists.tile_start = running_sum(entry_count);

    lists.entries.resize(lists.tile_start.back());
    std::vector<size_t> cursor(lists.tile_start.begin(), lists.tile_start.end() - 1);
    for (uint32_t gaussian : order) {
        uint32_t slot = uint32_t(lists.slot_start[gaussian]);
        for_each_tile(footprints[gaussian], grid,
            [&](size_t tile) { lists.entries[cursor[tile]++] = {gaussian, slot++}; });
    }
    return lists;
}
