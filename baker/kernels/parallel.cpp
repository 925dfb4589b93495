#include "parallel.h"

#include <algorithm>
#include <atomic>
#include <system_error>
#include <thread>
#include <vector>

static std::atomic<int> requested_threads{0};

void set_thread_count(int count)
{
    requested_threads = std::max(count, 0);
}

int thread_count()
{
    const int requested = requested_threads;
    return requested > 0 ? requested : std::max(1, int(std::thread::hardware_concurrency()));
}

void parallel_for(size_t count, size_t grain, const std::function<void(size_t, size_t)>& body)
{
    std::atomic<size_t> next{0};
    const auto work = [&] {
        for (size_t begin = next.fetch_add(grain); begin < count; begin = next.fetch_add(grain))
            body(begin, std::min(begin + grain, count));
    };

    const size_t chunks = (count + grain - 1) / grain;
    const size_t helpers = std::min<size_t>(thread_count(), chunks);
    std::vector<std::thread> threads;
    threads.reserve(helpers);
    try {
        while (threads.size() + 1 < helpers)
            threads.emplace_back(work);
    } catch (const std::system_error&) {
        // The system grants no more threads: those that run, this one at least, do all the work.
    }
    work();
    for (std::thread& thread : threads)
        thread.join();
}
