#include "loss/loss.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "dispatch.h"
#include "parallel.h"

static constexpr double WINDOW_SIGMA = 1.5; // px
static constexpr size_t BAND = 64;          // rows per task

template <class Real> static void fill_taps(Real* taps)
{
    double row[WINDOW_RADIUS + 1], sum = 0;
    for (size_t k = 0; k <= WINDOW_RADIUS; ++k) {
        const double x = (double(WINDOW_RADIUS) - double(k)) / WINDOW_SIGMA;
        row[k] = std::exp(-0.5 * x * x);
        sum += (k < WINDOW_RADIUS ? 2 : 1) * row[k];
    }
    for (size_t k = 0; k <= WINDOW_RADIUS; ++k)
        taps[k] = Real(row[k] / sum);
}

template <class Real> static LossProblem<Real> problem_of(const LossImages<Real>& images)
{
    LossProblem<Real> problem = {images, {}, 0, 0, 0, 0};
    fill_taps(problem.taps);
    const RowIndex height = RowIndex(images.height), width = RowIndex(images.width);
    if (std::min(height, width) >= RowIndex(WINDOW))
        problem.window_rows = height - HALO, problem.window_columns = width - HALO;
    const RowIndex samples = 3 * height * width, windows = 3 * problem.window_rows * problem.window_columns;
    const RowIndex valid = samples - std::count(images.tone, images.tone + samples, INVALID_TONE);
    problem.l1_unit = Real(L1_WEIGHT / double(std::max<RowIndex>(valid, 1)));
    problem.unlike_unit = Real((1 - L1_WEIGHT) / 2 / double(std::max<RowIndex>(windows, 1)));
    return problem;
}

namespace {

// The row buffers of one thread, kept between calls.
template <class Real> class Workspace {
public:
    const LossRows<Real>& rows_for(const LossProblem<Real>& problem)
    {
        if (problem.images.width != rows.width)
            allocate(problem.images.width);
        if (problem.window_rows == 0) {
            std::fill_n(rows.by_tone, BATCH * rows.stride, Real(0));
            std::fill_n(rows.unlike, rows.stride, Real(0));
        }
        return rows;
    }

private:
    void allocate(size_t width)
    {
        const size_t whole_strips = (3 * (width + HALO) + STRIP - 1) / STRIP * STRIP;
        rows.width = width, rows.stride = whole_strips + 16; // not a power of two: rows share no cache sets
        memory.assign((2 * RING + MAPS * BATCH + SHARES + SHARES * RING + BATCH + 1) * rows.stride, 0);
        Real* next = memory.data();
        const auto take = [&](size_t count) { return std::exchange(next, next + count * rows.stride); };
        rows.a = take(RING), rows.d = take(RING), rows.maps = take(MAPS * BATCH), rows.shares = take(SHARES);
        rows.blurred = take(SHARES * RING), rows.by_tone = take(BATCH), rows.unlike = take(1);
    }

    std::vector<Real> memory;
    LossRows<Real> rows = {};
};

} // namespace

template <class Real> static double loss_of(const LossImages<Real>& images, LossBand<Real>* band)
{
    const LossProblem<Real> problem = problem_of(images);
    std::vector<LossSums> bands((images.height + BAND - 1) / BAND);
    parallel_for(images.height, BAND, [&](size_t first, size_t end) {
        thread_local Workspace<Real> workspace;
        bands[first / BAND] = band(problem, RowIndex(first), RowIndex(end), workspace.rows_for(problem));
    });
    LossSums sums = {};
    for (const LossSums& part : bands)
        sums.l1 += part.l1, sums.unlike += part.unlike;
    return double(problem.l1_unit) * sums.l1 + double(problem.unlike_unit) * sums.unlike;
}

double image_loss(const LossImages<float>& images)
{
    return loss_of(images, instruction_set().loss_float);
}

double image_loss(const LossImages<double>& images)
{
    return loss_of(images, instruction_set().loss_double);
}
