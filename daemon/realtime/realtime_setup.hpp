// Asks the kernel for real time and says what it gave. Everything here happens before the first
// cycle.
#pragma once

#include <cstddef>
#include <string>

namespace eampc::realtime {

enum class RealtimeRequest : unsigned char { kOff, kWarn, kEnforce };

struct RealtimeSettings {
  RealtimeRequest request = RealtimeRequest::kWarn;
  int priority =
      70;  // SCHED_FIFO; above the threaded interrupts' default of 50, below the kernel's own 99
  int cpu = -1;  // -1: any
};

struct RealtimeState {
  std::string text;  // what was asked for and what was achieved, for people
  bool achieved = true;
};

// With mlockall every stack becomes resident in full, the library's threads included: 8 MB each by
// default.
inline constexpr std::size_t kThreadStackBytes = 256 * 1024;

// One heap arena, small default stacks. Call before the first thread starts.
void bound_memory() noexcept;

// Locks the memory of the process. Call after everything is loaded, before the loop starts.
RealtimeState lock_memory(const RealtimeSettings& settings);

// For the calling thread: policy, priority, affinity, and its stack touched once.
RealtimeState enter_realtime(const RealtimeSettings& settings);

}  // namespace eampc::realtime
