#include "service/bus_keeper.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace eampc::service {
namespace {

// Two periods at 200 Hz: the interface is restarted before a person could switch the node on.
constexpr std::chrono::milliseconds kLook{10};

}  // namespace

bool RestartPolicy::due(const realtime::BusReport& report, Instant now) {
  if (!report.health.bus_off && !report.stale_command_possible) return false;
  if (restarted_before_) {
    if (report.confirmed_frames != confirmed_at_last_) pause_ = kFirstPause;
    if (now - last_ < pause_) return false;
    pause_ = std::min(2 * pause_, kLongestPause);
  }
  restarted_before_ = true;
  last_ = now;
  confirmed_at_last_ = report.confirmed_frames;
  return true;
}

std::string describe_change(const realtime::BusReport& before, const realtime::BusReport& after) {
  std::string text;
  const auto say = [&](const std::string& words) { text += (text.empty() ? "" : "; ") + words; };
  const control::BusHealth& old = before.health;
  const control::BusHealth& now = after.health;
  if (after.link_downs != before.link_downs) say("the interface went down or away");
  if (old.link_down && !now.link_down) say("the interface is back");
  if (after.monitor.bus_offs != before.monitor.bus_offs) say("bus-off");
  if (after.monitor.restarts != before.monitor.restarts) say("the controller was restarted");
  if (after.monitor.passives != before.monitor.passives) {
    say("error passive, counters " + std::to_string(after.transmit_errors) + " sending and " +
        std::to_string(after.receive_errors) + " receiving");
  }
  if (old.error_passive && !now.error_passive) say("no longer error passive");
  if (before.monitor.not_acknowledged == 0 && after.monitor.not_acknowledged != 0) {
    say("a frame was not acknowledged: no other node is on the bus");
  }
  if (before.send_errors == 0 && after.send_errors != 0) say("a frame was refused");
  if (before.monitor.foreign_commands == 0 && after.monitor.foreign_commands != 0) {
    say("another program or node sends our command's identifier");
  }
  if (!before.stale_command_possible && after.stale_command_possible) {
    say("an old command may still wait in the interface");
  }
  if (!old.queue_proved_empty && now.queue_proved_empty) say("the queue is proved empty");
  return text;
}

BusKeeper::BusKeeper(const realtime::ControlLoop& loop, std::string bus_name,
                     std::function<std::string()> restart)
    : loop_(loop), bus_name_(std::move(bus_name)), restart_(std::move(restart)) {}

void BusKeeper::start() {
  thread_ = std::thread([this] { watch(); });
}

void BusKeeper::stop() {
  stop_.store(true);
  if (thread_.joinable()) thread_.join();
}

void BusKeeper::watch() {
  RestartPolicy policy;
  realtime::BusReport before = loop_.bus_report();
  while (!stop_.load()) {
    std::this_thread::sleep_for(kLook);
    const realtime::BusReport report = loop_.bus_report();
    if (const std::string change = describe_change(before, report); !change.empty()) {
      spdlog::warn("{}: {}", bus_name_, change);
    }
    before = report;
    if (!restart_ || !policy.due(report, std::chrono::steady_clock::now())) continue;
    const std::string failure = restart_();
    if (failure.empty()) {
      spdlog::warn("{}: restarted, its queue is empty", bus_name_);
    } else {
      spdlog::error("{}", failure);
    }
  }
}

}  // namespace eampc::service
