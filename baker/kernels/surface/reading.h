// What sums of weights come to at points, and how errors count there.
#pragma once

#include <cstddef>

// light (count, 3) and inverse (count,) 1 / sum w, from sums (count, 4) of the fine level and the light
// (count, 3) of the coarse one, which fills the gap where the fine one weighs less than `floor`. yielding
// (count, 3) is the light that yields to a Gaussian whose weight grows: the coarse one in the gap, and else
// all.
void fill_gap(size_t count, const float* sums, const float* coarse, float floor, float* light, float* inverse,
    float* yielding);

// importance (count,) of errors at points read as light (count, 3): 1 / (l^2 + variance), where l is the
// level (count,) there, or the light's mean over the channels divided by `adapts` where that is more.
void importance_of(size_t count, const float* light, const float* level, const float* variance, float adapts,
    float* importance);

// by_light (count, 3): 2 importance residual / count. Returns the mean of importance |residual|^2.
double weigh(size_t count, const float* importance, const float* residual, float* by_light);
