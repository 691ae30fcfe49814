// The bus with its monitor: one command in flight, confirmations and error frames read on the way,
// a deleted interface reopened. The control loop's only way to the wire. Instants are the loop's
// own (ns): the monotonic clock, in lock-step the frames' time.
//   cost: the bus's, and one snapshot per report; no heap, no lock
#pragma once

#include <cstdint>

#include "realtime/bus.hpp"
#include "realtime/bus_monitor.hpp"
#include "realtime/snapshot.hpp"

namespace eampc::realtime {

// The bus as other threads see it.
struct BusReport {
  control::BusHealth health;
  bool stale_command_possible = false;  // BusMonitor::stale_command_possible
  std::uint8_t transmit_errors = 0;     // as the controller told last
  std::uint8_t receive_errors = 0;
  BusCounters monitor;
  std::int64_t send_errors = 0;
  std::int64_t confirmed_frames = 0;
  std::int64_t ignored_frames = 0;
  std::int64_t error_frames = 0;
  std::int64_t link_downs = 0;
};

class MonitoredBus {
 public:
  MonitoredBus(Bus& bus, std::int64_t period_ns) noexcept;

  // One read. Everything but data frames is dealt with here: kFrame, kMonitored, kNothing (the bus
  // has been read empty) or kIgnored come back.
  BusEvent receive(ReceivedFrame& received, std::int64_t now_ns) noexcept;

  // Sent, or kept until the command before it is confirmed.
  void command(const BusMonitor::Command& command, std::int64_t now_ns) noexcept;
  void sync(const control::Frame& frame, std::int64_t now_ns) noexcept;
  // For the end: a disabled command that follows an enabled one goes out although that one is not
  // confirmed yet. It cannot do anything but good.
  void last_command(const BusMonitor::Command& command, std::int64_t now_ns) noexcept;

  void reopen_if_gone(std::int64_t monotonic_ns) noexcept;

  bool in_flight() const noexcept { return monitor_.in_flight(); }
  control::BusHealth take_health(std::int64_t now_ns) noexcept {
    return monitor_.take_health(now_ns);
  }
  void publish(std::int64_t now_ns) noexcept;
  BusReport report() const noexcept { return published_.read(); }  // from any thread

  int fd() const noexcept { return bus_.fd(); }
  std::uint32_t receive_overflows() const noexcept { return bus_.receive_overflows(); }

 private:
  bool put(const control::Frame& frame) noexcept;
  void lose_link(bool gone) noexcept;

  Bus& bus_;
  BusMonitor monitor_;
  BusReport counts_;  // the counters; the rest is filled in by publish()
  bool link_lost_ = false;
  bool link_gone_ = false;
  std::int64_t reopen_at_ = 0;
  Snapshot<BusReport> published_;
};

}  // namespace eampc::realtime
