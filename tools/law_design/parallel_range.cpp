#include "law_design/parallel_range.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "law_design/mpqp.hpp"

namespace eampc::law_design {

int thread_count(int wanted) {
  if (wanted > 0) return wanted;
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void parallel_range(int count, int threads, const std::function<void(int, int)>& work,
                    const LoopProgress& progress) {
  constexpr int kBlock = 16;
  std::atomic<int> next{0};
  std::atomic<bool> stop{false};
  std::exception_ptr failure;
  std::mutex failure_guard;
  const auto fail = [&](std::exception_ptr error) {
    const std::lock_guard<std::mutex> lock(failure_guard);
    if (!failure) failure = std::move(error);
    stop = true;
  };
  const auto run = [&](int thread) {
    try {
      while (!stop) {
        const int first = next.fetch_add(kBlock);
        if (first >= count) return;
        if (thread == 0 && progress && !progress(first, count)) throw Cancelled();
        for (int i = first; i < std::min(first + kBlock, count); ++i) work(i, thread);
      }
    } catch (...) {
      fail(std::current_exception());
    }
  };
  std::vector<std::thread> others;
  others.reserve(static_cast<std::size_t>(std::max(threads - 1, 0)));
  for (int t = 1; t < threads; ++t) others.emplace_back(run, t);
  run(0);
  for (std::thread& other : others) other.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace eampc::law_design
