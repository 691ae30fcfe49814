// Any story of a bus through the monitor, beside a model of the kernel's queue: it keeps what it
// was handed, in order, sends it late, twice never, or loses it. The rule that matters: an enabled
// command is never handed over while an older enabled one may still reach the valves.
#include <deque>

#include "fuzz/fuzz_target.hpp"
#include "realtime/bus_monitor.hpp"

namespace {

using eampc::control::BusHealth;
using eampc::fuzz::ByteReader;
using eampc::fuzz::require;
using eampc::realtime::BusMonitor;

constexpr std::int64_t kPeriodNs = 5'000'000;

class Story {
 public:
  explicit Story(ByteReader bytes) noexcept : bytes_(bytes) {}

  void run() {
    while (!bytes_.at_end()) {
      play(bytes_.take<std::uint8_t>());
      require(queue_.size() < 4096, "the queue of a story is bounded by its length");
    }
  }

 private:
  void play(std::uint8_t code) {
    switch (code % 12) {
      case 0:
        return command(true);
      case 1:
        return command(false);
      case 2:
      case 3:
        return transmit();
      case 4:
        now_ns_ += 1000 * std::int64_t{bytes_.take<std::uint16_t>()};
        return;
      case 5:
        now_ns_ += kPeriodNs * bytes_.take<std::uint8_t>();
        return;
      case 6:
        return error_frame();
      case 7:  // down: the kernel forgets everything
        queue_.clear();
        monitor_.on_link_lost();
        return;
      case 8:
        monitor_.on_received();
        return;
      case 9:  // lost in the controller
        if (!queue_.empty()) queue_.pop_front();
        return;
      case 10:
        return take_health();
      case 11: {  // a confirmation of nothing
        BusMonitor::Command kept;
        eampc::control::Frame stray = frame(true);
        stray.data[7] = 1;
        require(!monitor_.on_confirmed(stray, kept), "a stray confirmation lets nothing out");
        return;
      }
    }
  }

  // The commands of a rig: an enable bit and a rolling counter.
  eampc::control::Frame frame(bool enabled) noexcept {
    eampc::control::Frame frame;
    frame.id = 0x201;
    frame.length = 8;
    frame.data[0] = enabled ? 1 : 0;
    frame.data[1] = counter_ & 15;
    return frame;
  }

  void command(bool enabled) {
    ++counter_;
    const BusMonitor::Command wanted{frame(enabled), enabled};
    if (monitor_.admit(wanted, now_ns_)) hand_over(wanted);
  }

  void hand_over(const BusMonitor::Command& command) {
    if (command.enabled) {
      for (const BusMonitor::Command& waiting : queue_) {
        require(!waiting.enabled, "an enabled command waits for every older one");
      }
    }
    if (bytes_.take<std::uint8_t>() == 255) {
      monitor_.on_refused();
      return;
    }
    queue_.push_back(command);
    monitor_.on_sent(command, now_ns_);
    require(monitor_.in_flight(), "what was sent is in flight");
    require(monitor_.enabled_in_flight() == command.enabled, "its enable bit is known");
  }

  void transmit() {
    if (queue_.empty()) return;
    const BusMonitor::Command front = queue_.front();
    queue_.pop_front();
    if (bytes_.take<std::uint8_t>() == 255) return;  // the confirmation overflowed our socket
    BusMonitor::Command kept;
    if (monitor_.on_confirmed(front.frame, kept) && monitor_.admit(kept, now_ns_)) hand_over(kept);
  }

  void error_frame() {
    eampc::control::Frame raw;
    raw.id = bytes_.take<std::uint32_t>() & 0x1fffffffu;
    raw.length = 8;
    for (std::uint8_t& byte : raw.data) byte = bytes_.take<std::uint8_t>();
    const auto report = eampc::realtime::decode_error_frame(raw);
    monitor_.on_error_frame(report);
    const BusHealth health = monitor_.health(now_ns_);
    require(!report.bus_off || report.restarted || health.bus_off, "bus-off is told");
    require(!report.bus_off || !health.queue_proved_empty, "nothing is proved after bus-off");
    require(!report.not_acknowledged || health.not_acknowledged, "a missing answer is told");
  }

  void take_health() {
    const BusHealth before = monitor_.health(now_ns_);
    const BusHealth taken = monitor_.take_health(now_ns_);
    require(before.bus_off == taken.bus_off && before.link_down == taken.link_down &&
                before.unconfirmed_periods == taken.unconfirmed_periods,
            "taking the health tells what reading it told");
    require((taken.unconfirmed_periods > 0) == monitor_.in_flight(),
            "periods are counted while a command is in flight");
    const BusHealth after = monitor_.health(now_ns_);
    require(!after.send_refused && !after.not_acknowledged, "what is over is told once");
  }

  ByteReader bytes_;
  BusMonitor monitor_{kPeriodNs, true};
  std::deque<BusMonitor::Command> queue_;
  std::int64_t now_ns_ = 1'000'000'000;
  std::uint8_t counter_ = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Story(ByteReader(data, size)).run();
  return 0;
}
