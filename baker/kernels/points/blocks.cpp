#include "points/blocks.h"

#include "parallel.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace {

constexpr int AXES = 6; // three of the position, three of the normal

struct Point {
    double at[AXES];
    int64_t index;
};

// The order of the points of a node: along the axis on which they spread most; where that is equal along the
// next one, and so on, and at last by index.
struct Order {
    int axes[AXES];

    Order(const Point* begin, const Point* end)
    {
        double sum[AXES] = {}, square[AXES] = {};
        for (const Point* point = begin; point < end; ++point)
            for (int i = 0; i < AXES; ++i) {
                sum[i] += point->at[i];
                square[i] += point->at[i] * point->at[i];
            }
        const double count = double(end - begin);
        double spread[AXES];
        for (int i = 0; i < AXES; ++i)
            spread[i] = square[i] / count - sum[i] / count * (sum[i] / count);
        const double extent = spread[0] + spread[1] + spread[2];
        for (int i = 3; i < AXES; ++i)
            spread[i] *= extent;
        std::iota(axes, axes + AXES, 0);
        std::stable_sort(axes, axes + AXES, [&](int a, int b) { return spread[a] > spread[b]; });
    }

    bool operator()(const Point& a, const Point& b) const
    {
        for (int axis : axes)
            if (a.at[axis] != b.at[axis])
                return a.at[axis] < b.at[axis];
        return a.index < b.index;
    }
};

// Only finite numbers have an order.
double finite(float number)
{
    return std::isfinite(number) ? number : 0.0;
}

// Around the origin, where squares lose no digits.
std::vector<Point> centred(size_t count, const float* position, const float* normal)
{
    double middle[3] = {};
    for (size_t i = 0; i < 3 * count; ++i)
        middle[i % 3] += finite(position[i]);
    std::vector<Point> points(count);
    for (size_t i = 0; i < count; ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            points[i].at[axis] = finite(position[3 * i + axis]) - middle[axis] / double(count);
            points[i].at[3 + axis] = finite(normal[3 * i + axis]);
        }
        points[i].index = int64_t(i);
    }
    return points;
}

} // namespace

void number_blocks(size_t count, const float* position, const float* normal, int depth, int64_t* number)
{
    std::vector<Point> points = centred(count, position, normal);
    std::vector<size_t> first = {0, count}; // of each node, and the end of the last
    for (int level = 0; level < depth; ++level) {
        std::vector<size_t> halves;
        for (size_t node = 0; node + 1 < first.size(); ++node) {
            halves.push_back(first[node]);
            halves.push_back(first[node] + (first[node + 1] - first[node]) / 2);
        }
        halves.push_back(count);
        parallel_for(first.size() - 1, 1, [&](size_t begin, size_t end) {
            for (size_t node = begin; node < end; ++node) {
                Point *low = &points[0] + first[node], *high = &points[0] + first[node + 1];
                std::nth_element(low, &points[0] + halves[2 * node + 1], high, Order(low, high));
            }
        });
        first = std::move(halves);
    }
    for (size_t node = 0; node + 1 < first.size(); ++node)
        for (size_t i = first[node]; i < first[node + 1]; ++i)
            number[points[i].index] = int64_t(node);
}
