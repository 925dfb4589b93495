#include "parallel.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <mutex>
#include <system_error>
#include <thread>
#include <unistd.h>

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

namespace {

// One loop. Threads claim its chunks in ascending order; the loop ends when all chunks are finished.
struct Loop {
    const std::function<void(size_t, size_t)>& body; // not used after all chunks are finished
    const size_t count, grain, chunks;
    std::atomic<int> places; // helpers that may still join
    std::atomic<size_t> next{0}, finished{0};

    // An exception in the body ends the process, because other threads still use data of the caller.
    void work() noexcept
    {
        for (size_t chunk = next.fetch_add(1); chunk < chunks; chunk = next.fetch_add(1)) {
            body(chunk * grain, std::min(chunk * grain + grain, count));
            if (finished.fetch_add(1) + 1 == chunks)
                finished.notify_all();
        }
    }
};

// Threads that wait for loops. A pool is never destroyed: its threads are detached and end with the process.
class Pool {
public:
    explicit Pool(pid_t pid)
        : owner(pid)
    {
    }

    const pid_t owner;
    std::mutex in_use; // one loop at a time

    void run(const std::shared_ptr<Loop>& loop, int helpers)
    {
        grow(helpers);
        {
            const std::lock_guard guard(handover);
            current = loop;
        }
        ++generation;
        generation.notify_all();
        loop->work();
        for (size_t finished = loop->finished; finished < loop->chunks; finished = loop->finished)
            loop->finished.wait(finished);
    }

private:
    void grow(int helpers)
    {
        try {
            for (; threads < helpers; ++threads)
                std::thread(&Pool::serve, this, generation.load()).detach();
        } catch (const std::system_error&) {
            // The system grants no more threads. The existing ones, at least the caller, do all the work.
        }
    }

    void serve(uint32_t seen)
    {
        for (;;) {
            generation.wait(seen);
            seen = generation;
            std::shared_ptr<Loop> loop;
            {
                const std::lock_guard guard(handover);
                loop = current;
            }
            if (loop->places.fetch_sub(1) > 0)
                loop->work();
        }
    }

    int threads = 0;
    std::mutex handover;
    std::shared_ptr<Loop> current;
    std::atomic<uint32_t> generation{0};
};

} // namespace

// A forked child process has none of the threads, so it gets its own pool.
static Pool& pool()
{
    static std::atomic<Pool*> instance{nullptr};
    const pid_t pid = getpid();
    Pool* existing = instance;
    while (!existing || existing->owner != pid) {
        auto created = std::make_unique<Pool>(pid);
        if (instance.compare_exchange_strong(existing, created.get()))
            return *created.release();
    }
    return *existing;
}

void parallel_for(size_t count, size_t grain, const std::function<void(size_t, size_t)>& body)
{
    const size_t chunks = (count + grain - 1) / grain;
    const int helpers = int(std::min<size_t>(thread_count(), chunks)) - 1;
    const auto loop = std::make_shared<Loop>(body, count, grain, chunks, helpers);
    std::unique_lock<std::mutex> pool_lock;
    if (helpers > 0) {
        Pool& threads = pool();
        pool_lock = std::unique_lock(threads.in_use, std::try_to_lock);
        if (pool_lock)
            return threads.run(loop, helpers);
    }
    loop->work(); // alone: one thread is enough, or another loop is using the pool
}
