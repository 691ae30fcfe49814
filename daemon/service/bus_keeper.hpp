// Watches the bus from an ordinary thread: says in the log what changed, and restarts the interface
// where that is allowed and the only way to get rid of an old command or of bus-off.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

#include "realtime/control_loop.hpp"

namespace eampc::service {

// When to restart. Pure: a report and an instant in, a decision out.
class RestartPolicy {
 public:
  using Instant = std::chrono::steady_clock::time_point;
  // A short circuit lasts; the pause doubles from the first to the second while nothing is
  // confirmed in between.
  static constexpr std::chrono::milliseconds kFirstPause{1000};
  static constexpr std::chrono::milliseconds kLongestPause{16'000};

  bool due(const realtime::BusReport& report, Instant now);

 private:
  bool restarted_before_ = false;
  Instant last_{};
  std::chrono::milliseconds pause_{kFirstPause};
  std::int64_t confirmed_at_last_ = 0;
};

// What changed from one report to the next, for people; empty if nothing did.
std::string describe_change(const realtime::BusReport& before, const realtime::BusReport& after);

class BusKeeper {
 public:
  // `restart` takes the interface down and up and returns an empty string or what went wrong; empty
  // function: not allowed.
  BusKeeper(const realtime::ControlLoop& loop, std::string bus_name,
            std::function<std::string()> restart);
  ~BusKeeper() { stop(); }
  BusKeeper(const BusKeeper&) = delete;
  BusKeeper& operator=(const BusKeeper&) = delete;

  void start();
  void stop();

 private:
  void watch();

  const realtime::ControlLoop& loop_;
  const std::string bus_name_;
  const std::function<std::string()> restart_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace eampc::service
