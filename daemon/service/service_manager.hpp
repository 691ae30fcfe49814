// systemd's readiness protocol (sd_notify(3), "Standalone Implementations"): one datagram per state
// on the socket that $NOTIFY_SOCKET names. Written out here: libsystemd would bring four libraries
// into memory that the daemon locks.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace eampc::service {

class ServiceManager {
 public:
  ServiceManager() = default;  // nobody listens: every notify() does nothing
  // $NOTIFY_SOCKET, $WATCHDOG_USEC and $WATCHDOG_PID, which are removed from the environment.
  static ServiceManager from_environment();

  // "READY=1", "STOPPING=1", "WATCHDOG=1", "STATUS=…"; several are separated by newlines. Never
  // waits: a manager that does not read loses the datagram. False: it was not delivered.
  bool notify(const std::string& state) const noexcept;

  // After so long without a "WATCHDOG=1" the manager ends the process; nothing: it does not watch.
  std::optional<std::chrono::microseconds> watchdog() const noexcept { return watchdog_; }

 private:
  std::string address_;  // a path, or '@' and an abstract name; empty: nobody listens
  std::optional<std::chrono::microseconds> watchdog_;
};

// Feeds the manager's watchdog, but only while the control loop moves on: a loop that hangs starves
// it, however healthy the rest of the process is.
class LoopWatchdog {
 public:
  // `turns` counts up while the loop lives. Both arguments must outlive the object.
  LoopWatchdog(const ServiceManager& manager, std::function<std::uint64_t()> turns)
      : manager_(manager), turns_(std::move(turns)) {}

  // Call more often than interval(). True: fed.
  bool feed();
  // A quarter of the manager's patience, a second if it does not watch.
  std::chrono::milliseconds interval() const noexcept;

 private:
  const ServiceManager& manager_;
  const std::function<std::uint64_t()> turns_;
  std::uint64_t last_turns_ = 0;
};

}  // namespace eampc::service
