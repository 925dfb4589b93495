#include "surface/reading.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "parallel.h"

static constexpr size_t POINT_GRAIN = 4096; // points of a thread at a time

void fill_gap(size_t count, const float* sums, const float* coarse, float floor, float* light, float* inverse,
    float* yielding)
{
    parallel_for(count, POINT_GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
            const float weight = sums[4 * i + 3], gap = std::max(floor - weight, 0.0f), all = weight + gap;
            inverse[i] = all >= std::numeric_limits<float>::min() ? 1 / all : 0;
            for (size_t c = 0; c < 3; ++c) {
                const size_t j = 3 * i + c;
                light[j] = (sums[4 * i + c] + gap * coarse[j]) * inverse[i];
                yielding[j] = weight < floor ? coarse[j] : light[j];
            }
        }
    });
}

void importance_of(size_t count, const float* light, const float* level, const float* variance, float adapts,
    float* importance)
{
    const float share = 1 / (3 * adapts);
    parallel_for(count, POINT_GRAIN, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
            const float bright = std::abs(light[3 * i] + light[3 * i + 1] + light[3 * i + 2]) * share,
                        l = std::max(level[i], bright);
            importance[i] = 1 / (l * l + variance[i]);
        }
    });
}

double weigh(size_t count, const float* importance, const float* residual, float* by_light)
{
    std::vector<double> parts((count + POINT_GRAIN - 1) / POINT_GRAIN);
    const double scale = 1 / std::max(double(count), 1.0);
    parallel_for(count, POINT_GRAIN, [&](size_t begin, size_t end) {
        double loss = 0;
        for (size_t i = begin; i < end; ++i) {
            float squared = 0;
            for (size_t j = 3 * i; j < 3 * i + 3; ++j) {
                squared += residual[j] * residual[j];
                by_light[j] = float(2 * scale) * importance[i] * residual[j];
            }
            loss += importance[i] * squared;
        }
        parts[begin / POINT_GRAIN] = loss;
    });
    return scale * std::accumulate(parts.begin(), parts.end(), 0.0);
}
