// A loop over independent jobs on several threads.
#ifndef MECHKIT_BASE_PARALLEL_HPP
#define MECHKIT_BASE_PARALLEL_HPP

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace mk
{

// As many as are wanted; as there are processors where none are.
inline int threads_for(int wanted)
{
    return wanted > 0 ? wanted : std::max(1, (int)std::thread::hardware_concurrency());
}

// Calls body(0 .. count - 1), each once, on up to `threads` threads, this one included. Jobs are
// handed out in order. The first exception stops the handing out and is thrown again here. Where
// the system gives no more threads, fewer do the work.
template <class F>
void parallel_for(int threads, size_t count, F &&body)
{
    if (threads <= 1 || count < 2) {
        for (size_t i = 0; i < count; i++)
            body(i);
        return;
    }
    std::atomic<size_t> next{0};
    std::exception_ptr failure;
    std::mutex failing;
    auto worker = [&] {
        try {
            for (size_t i; (i = next++) < count;)
                body(i);
        } catch (...) {
            std::lock_guard<std::mutex> lock(failing);
            if (!failure)
                failure = std::current_exception();
            next = count;
        }
    };
    std::vector<std::thread> team;
    team.reserve((size_t)threads);
    for (int i = 1; i < threads && (size_t)i < count; i++) {
        try {
            team.emplace_back(worker);
        } catch (const std::system_error &) {
            break;
        }
    }
    worker();
    for (std::thread &member : team)
        member.join();
    if (failure)
        std::rethrow_exception(failure);
}

} // namespace mk
#endif
