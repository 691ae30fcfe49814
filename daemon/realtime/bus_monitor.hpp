// What happened on the bus, and when → control::BusHealth, and which command frame may go out.
// Pure: whoever owns the socket reports events with instants of one monotonic clock (ns).
//
//   one in flight   A command waits for its confirmation (MSG_CONFIRM) before the next one is
//                   handed to the kernel; meanwhile the newest wanted one is kept, older ones are
//                   dropped, an enabled one after 1.5 periods, too. With nobody to acknowledge, a
//                   kernel without this rule keeps a dozen commands and delivers them whenever a
//                   node comes back, whoever still lives.
//   stale queue     After the start, link up and bus-off an older command may still wait in the
//                   interface. Then only disabled commands go out, and the queue is proved empty
//                   once one of them was confirmed: a queue keeps its order. Such a probe must
//                   differ from every command before an enabled one that was given up, or the late
//                   confirmation of the former (rolling counters wrap) would prove too much.
//
// A bus that confirms nothing (emulation) has no queue: everything may go out at once.
// Cost: constant. Absent: sockets, clocks, actions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "control/bus_health.hpp"
#include "control/control_types.hpp"
#include "realtime/error_frame.hpp"

namespace eampc::realtime {

struct BusCounters {
  std::int64_t bus_offs = 0;
  std::int64_t restarts = 0;
  std::int64_t passives = 0;          // times the controller became error passive
  std::int64_t not_acknowledged = 0;  // error frames that said so
  std::int64_t controller_overflows = 0;
  std::int64_t withheld_commands = 0;    // periods whose command was kept or refused
  std::int64_t lost_confirmations = 0;   // given up after kLost
  std::int64_t stray_confirmations = 0;  // of a frame that was given up before
  std::int64_t foreign_commands = 0;     // somebody else sends our identifiers
};

class BusMonitor {
 public:
  // Longer than any frame waits on a bus that others use: 7,000 frames at 1 Mbit/s.
  static constexpr std::int64_t kLostNs = 1'000'000'000;

  static constexpr std::int64_t kNotKept = -1;

  struct Command {
    control::Frame frame;
    bool enabled = false;             // the enable bit as it stands in the frame
    std::int64_t kept_at = kNotKept;  // set by the monitor when the command has to wait
  };

  BusMonitor(std::int64_t period_ns, bool confirms) noexcept;

  void on_error_frame(const ErrorReport& report) noexcept;
  void on_link_lost() noexcept;  // down or deleted; both purge what the kernel holds
  void on_received() noexcept;   // a data frame of another node
  void on_foreign_command() noexcept;

  // A command is wanted. True: hand it to the kernel now and tell on_sent() or on_refused(). False:
  // it is kept, or must not go out at all.
  bool admit(const Command& command, std::int64_t now_ns) noexcept;
  void on_sent(const Command& command, std::int64_t now_ns) noexcept;
  void on_refused() noexcept;
  // The same for the Sync frame: one that waits is not followed by another, so that no row of them
  // stands before a command.
  bool admit_sync(std::int64_t now_ns) const noexcept;
  void on_sync_sent(const control::Frame& sync, std::int64_t now_ns) noexcept;

  // An own frame came back. True: a kept command may be admitted now; it is in `kept`.
  bool on_confirmed(const control::Frame& frame, Command& kept) noexcept;

  // As of `now_ns`; what happened and is over is told once.
  control::BusHealth take_health(std::int64_t now_ns) noexcept;
  // The same without forgetting anything.
  control::BusHealth health(std::int64_t now_ns) const noexcept;

  // An enabled command was handed to the kernel and may still reach the valves, although its time
  // is over: only an interface that is taken down and up forgets it.
  bool stale_command_possible(std::int64_t now_ns) const noexcept;
  bool in_flight() const noexcept { return in_flight_; }
  bool enabled_in_flight() const noexcept { return in_flight_ && flying_.enabled; }
  const BusCounters& counters() const noexcept { return counters_; }
  const ErrorReport& newest_report() const noexcept { return report_; }

 private:
  // Twice the frames of a 4-bit counter. Beyond it only a restart of the interface helps.
  static constexpr std::size_t kMostGivenUp = 32;

  void give_up_frame() noexcept;
  void remember(const Command& given_up) noexcept;
  // As a probe: its confirmation proves that no enabled command waits any more.
  bool tells_apart(const control::Frame& probe) const noexcept;
  // True: a command of these bytes was given up; it and all older ones are forgotten.
  bool forget_up_to(const control::Frame& confirmed) noexcept;
  std::size_t first_after_enabled() const noexcept;
  std::int32_t unconfirmed_periods(std::int64_t now_ns) const noexcept;

  const std::int64_t period_ns_;
  const bool confirms_;

  bool in_flight_ = false;
  Command flying_;
  std::int64_t sent_at_ = 0;
  bool heard_since_sent_ = false;
  bool has_kept_ = false;
  Command kept_;
  bool sync_in_flight_ = false;
  control::Frame sync_;
  std::int64_t sync_sent_at_ = 0;
  bool proved_empty_;
  // Given up, and nothing has shown since that they left the queue; oldest first.
  std::array<Command, kMostGivenUp> given_up_{};
  bool given_up_too_many_ = false;
  std::size_t given_up_count_ = 0;
  bool enabled_given_up_ = false;  // an enabled command was given up and nothing purged it

  bool link_down_ = false;
  bool bus_off_ = false;
  bool passive_ = false;
  control::BusHealth happened_;  // since take_health()
  ErrorReport report_;
  BusCounters counters_;
};

}  // namespace eampc::realtime
