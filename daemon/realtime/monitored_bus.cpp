#include "realtime/monitored_bus.hpp"

namespace eampc::realtime {
namespace {

// A deleted interface is looked for ten times a second: three system calls that find nothing.
constexpr std::int64_t kReopenNs = 100'000'000;

}  // namespace

MonitoredBus::MonitoredBus(Bus& bus, std::int64_t period_ns) noexcept
    : bus_(bus), monitor_(period_ns, bus.confirms()) {
  publish(0);
}

BusEvent MonitoredBus::receive(ReceivedFrame& received, std::int64_t now_ns) noexcept {
  const BusEvent event = bus_.receive(received);
  switch (event) {
    case BusEvent::kFrame:
    case BusEvent::kMonitored:
      monitor_.on_received();
      return event;
    case BusEvent::kNothing:
      return event;
    case BusEvent::kConfirmed: {
      ++counts_.confirmed_frames;
      BusMonitor::Command kept;
      if (monitor_.on_confirmed(received.frame, kept)) command(kept, now_ns);
      break;
    }
    case BusEvent::kErrorFrame:
      ++counts_.error_frames;
      monitor_.on_error_frame(decode_error_frame(received.frame));
      break;
    case BusEvent::kForeignCommand:
      ++counts_.ignored_frames;
      monitor_.on_foreign_command();
      break;
    case BusEvent::kIgnored:
      ++counts_.ignored_frames;
      break;
    case BusEvent::kLinkDown:
    case BusEvent::kLinkGone:
      lose_link(event == BusEvent::kLinkGone);
      publish(now_ns);
      return BusEvent::kNothing;
  }
  publish(now_ns);
  return BusEvent::kIgnored;
}

bool MonitoredBus::put(const control::Frame& frame) noexcept {
  switch (bus_.send(frame)) {
    case SendResult::kSent:
      link_lost_ = false;
      return true;
    case SendResult::kRefused:
      monitor_.on_refused();
      break;
    case SendResult::kLinkDown:
      lose_link(false);
      break;
    case SendResult::kLinkGone:
      lose_link(true);
      break;
  }
  ++counts_.send_errors;
  return false;
}

void MonitoredBus::command(const BusMonitor::Command& command, std::int64_t now_ns) noexcept {
  if (monitor_.admit(command, now_ns) && put(command.frame)) monitor_.on_sent(command, now_ns);
}

void MonitoredBus::last_command(const BusMonitor::Command& command, std::int64_t now_ns) noexcept {
  if (monitor_.enabled_in_flight()) {
    put(command.frame);
  } else {
    this->command(command, now_ns);
  }
}

void MonitoredBus::sync(const control::Frame& frame, std::int64_t now_ns) noexcept {
  if (monitor_.admit_sync(now_ns) && put(frame)) monitor_.on_sync_sent(frame, now_ns);
}

void MonitoredBus::lose_link(bool gone) noexcept {
  if (!link_lost_) ++counts_.link_downs;
  link_lost_ = true;
  link_gone_ |= gone;
  monitor_.on_link_lost();
}

void MonitoredBus::reopen_if_gone(std::int64_t monotonic_ns) noexcept {
  if (!link_gone_ || monotonic_ns < reopen_at_) return;
  link_gone_ = !bus_.reopen();
  reopen_at_ = monotonic_ns + kReopenNs;
}

void MonitoredBus::publish(std::int64_t now_ns) noexcept {
  BusReport report = counts_;
  report.health = monitor_.health(now_ns);
  report.stale_command_possible = monitor_.stale_command_possible(now_ns);
  report.transmit_errors = monitor_.newest_report().transmit_errors;
  report.receive_errors = monitor_.newest_report().receive_errors;
  report.monitor = monitor_.counters();
  published_.write(report);
}

}  // namespace eampc::realtime
