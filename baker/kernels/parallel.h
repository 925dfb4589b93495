// Runs a loop body on all cores.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

// Sets the number of threads for later loops; 0 means one per core (the default).
void set_thread_count(int count);
int thread_count();

// Calls body(begin, end) for consecutive ranges of at most `grain` indices that cover [0, count), in any
// order, on any thread. The split does not depend on the number of threads. The body must not throw.
void parallel_for(size_t count, size_t grain, const std::function<void(size_t, size_t)>& body);

// Lowers `least` to `value`, from any thread.
inline void lower(std::atomic<size_t>& least, size_t value)
{
    size_t before = least;
    while (value < before && !least.compare_exchange_weak(before, value)) { }
}
