#include "realtime/realtime_setup.hpp"

#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace eampc::realtime {
namespace {

// Half of the loop's stack: more than the cycle's deepest call, less than the guard page.
constexpr std::size_t kPrefaultBytes = kThreadStackBytes / 2;

[[gnu::noinline]] void prefault_stack() noexcept {
  std::array<volatile unsigned char, kPrefaultBytes> stack;
  constexpr std::size_t kPageBytes = 4096;  // the smallest page of the supported machines
  for (std::size_t i = 0; i < stack.size(); i += kPageBytes) stack[i] = 0;
}

}  // namespace

void bound_memory() noexcept {
  ::mallopt(M_ARENA_MAX, 1);
  pthread_attr_t attributes;
  if (::pthread_attr_init(&attributes) != 0) return;
  if (::pthread_attr_setstacksize(&attributes, kThreadStackBytes) == 0) {
    ::pthread_setattr_default_np(&attributes);
  }
  ::pthread_attr_destroy(&attributes);
}

RealtimeState lock_memory(const RealtimeSettings& settings) {
  if (settings.request == RealtimeRequest::kOff) return {"memory not locked (not asked for)", true};
  // An unprivileged process may raise its own soft limit as far as the hard one.
  rlimit limit{};
  if (::getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur < limit.rlim_max) {
    limit.rlim_cur = limit.rlim_max;
    ::setrlimit(RLIMIT_MEMLOCK, &limit);
  }
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    return {std::string("memory not locked (") + std::strerror(errno) +
                "; needs CAP_IPC_LOCK or a larger limit on locked memory)",
            false};
  }
  return {"memory locked", true};
}

RealtimeState enter_realtime(const RealtimeSettings& settings) {
  prefault_stack();
  RealtimeState state;
  if (settings.cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(static_cast<unsigned>(settings.cpu), &cpus);
    const int error = ::pthread_setaffinity_np(::pthread_self(), sizeof cpus, &cpus);
    if (error == 0) {
      state.text = "cpu " + std::to_string(settings.cpu) + ", ";
    } else {
      state.text =
          "cpu " + std::to_string(settings.cpu) + " refused (" + std::strerror(error) + "), ";
      state.achieved = false;
    }
  }
  if (settings.request == RealtimeRequest::kOff) {
    state.text += "SCHED_OTHER (real time not asked for)";
    return state;
  }
  sched_param parameters{};
  parameters.sched_priority = settings.priority;
  const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
  int policy = SCHED_OTHER;
  ::pthread_getschedparam(::pthread_self(), &policy, &parameters);
  if (error == 0 && policy == SCHED_FIFO) {
    state.text += "SCHED_FIFO priority " + std::to_string(parameters.sched_priority);
  } else {
    state.text += "SCHED_OTHER (SCHED_FIFO priority " + std::to_string(settings.priority) +
                  " refused: " + std::strerror(error) + "; needs CAP_SYS_NICE)";
    state.achieved = false;
  }
  return state;
}

}  // namespace eampc::realtime
