// The real-time thread's body: wait for the encoder frame → ControlCycle::step → send → push the
// record. After run() starts there is no heap, lock, log or throw here. One thread runs it; the
// rest of the process talks to it through the queues, the snapshot and the counters.
//
// When a cycle runs:
//   encoder trigger   on every encoder frame. If several wait, the newest counts and the older ones
//   are `superseded`.
//                     Once a frame was seen, a period without one (half a period of slack) runs a
//                     cycle without a frame. A frame that comes less than half a period after a
//                     frame's cycle, or a quarter after one without, belongs to a period that is
//                     over: `late`.
//   sync trigger      on a fixed grid: Sync goes out, the encoder's answer starts the cycle; no
//   answer by 7/8 of the
//                     period: a cycle without a frame. A missed grid point is skipped, the grid
//                     stays.
//   starvation        a gap between two cycles that is longer than safety.encoder_timeout_s and the
//                     trigger's slack is told to the cycle as periods without a sample, whatever
//                     the frames that wait say; a superseded frame that waited longer than a period
//                     is a missed deadline.
//   lock-step         on every encoder frame in order, none left out, no clock; Sync is not sent,
//   because the frames
//                     themselves are the time. A full record queue makes the loop wait instead of
//                     dropping.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "control/control_cycle.hpp"
#include "realtime/command_queue.hpp"
#include "realtime/latency_histogram.hpp"
#include "realtime/monitored_bus.hpp"
#include "realtime/record_queue.hpp"
#include "realtime/snapshot.hpp"

namespace eampc::realtime {

struct LoopSettings {
  bool lockstep = false;
};

// Everything one cycle leaves behind for telemetry, recorder and status. Trivially copyable.
struct LoopRecord {
  control::CycleRecord cycle;
  bool frame_seen = false;  // this cycle had an encoder frame
  bool at_rest = true;
  std::uint64_t executed_command = 0;  // LoopCommand::id of the last one taken for "now"
  std::int64_t arrival_ns = 0;  // CLOCK_REALTIME; of the frame, or when its absence was noticed
  double arrival_to_wake_us = 0.0;
  double wake_to_decided_us = 0.0;
  double decided_to_sent_us = 0.0;
  double arrival_to_sent_us = 0.0;
};

// 4096 records: 4 s at 1 kHz for the service thread to catch up after a slow disk.
using LoopRecordQueue = RecordQueue<LoopRecord, 4096>;

struct LoopCounters {
  std::int64_t cycles = 0;
  std::int64_t encoder_frames = 0;
  std::int64_t valid_frames = 0;
  std::int64_t encoder_timeouts = 0;   // periods that passed without a frame
  std::int64_t superseded_frames = 0;  // waited behind a newer one
  std::int64_t late_frames = 0;
  std::int64_t duplicate_frames = 0;
  std::int64_t invalid_frames = 0;
  std::int64_t deadline_overruns = 0;  // arrival to sent (or to being superseded) took over a
                                       // period, or a grid point was skipped
  std::int64_t send_errors = 0;
  std::int64_t confirmed_frames = 0;
  std::int64_t ignored_frames = 0;
  std::int64_t error_frames = 0;
  std::int64_t link_downs = 0;
  std::int64_t receive_overflows = 0;
  std::int64_t telemetry_dropped = 0;

  // Periods that had no measurement of their own, whoever was late.
  std::int64_t missed_cycles() const noexcept { return encoder_timeouts + superseded_frames; }
};

class ControlLoop {
 public:
  // Commands for a later cycle that may wait at once; whoever hands them over keeps to it. The
  // other half of the room stays free for what an operator wants now: a disarm must never queue
  // behind a plan.
  static constexpr std::size_t kMaxScheduled = 16;

  // All arguments must outlive the loop.
  ControlLoop(Bus& bus, const control::ControllerConfig& config, LoopSettings settings);

  // Returns after request_stop(), outputs at the safe value, the last frame sent.
  void run() noexcept EAMPC_NONBLOCKING;
  void request_stop() noexcept;  // from any thread

  CommandQueue& commands() noexcept { return commands_; }
  LoopRecordQueue& records() noexcept { return records_; }
  ReleasedTableQueue& released_tables() noexcept { return released_tables_; }
  LoopRecord newest() const noexcept { return newest_.read(); }
  BusReport bus_report() const noexcept { return bus_.report(); }
  LoopCounters counters() const noexcept;
  // How many commands for a later cycle were executed or dropped so far.
  std::int64_t scheduled_done() const noexcept {
    return scheduled_done_.load(std::memory_order_relaxed);
  }
  // Counts on at least every 20 ms or every period while the loop lives, frames or not.
  std::uint64_t turns() const noexcept { return turns_.load(std::memory_order_relaxed); }
  const LatencyHistogram& arrival_to_sent() const noexcept { return arrival_to_sent_; }

 private:
  enum class Wait : std::uint8_t { kFrame, kDeadline, kStop };

  // A frame with the instants that belong to it.
  struct Arrival {
    ReceivedFrame received;
    std::int64_t arrival_ns = 0;  // CLOCK_REALTIME
    std::int64_t arrived_at = 0;  // the same instant, CLOCK_MONOTONIC
    std::int64_t woken_at = 0;    // CLOCK_MONOTONIC
  };

  struct CounterCells {
    std::atomic<std::int64_t> cycles{0}, encoder_frames{0}, valid_frames{0}, encoder_timeouts{0},
        superseded_frames{0}, late_frames{0}, duplicate_frames{0}, invalid_frames{0},
        deadline_overruns{0}, receive_overflows{0};
  };

  void run_on_encoder() noexcept;
  void run_on_sync() noexcept;
  Wait wait_for_frame(std::int64_t deadline, Arrival& arrival) noexcept;
  bool take_frame(Arrival& arrival) noexcept;
  void discard_waiting_frames() noexcept;
  void run_cycle(const control::Frame* frame, const Arrival& arrival) noexcept;
  void run_cycle_without_frame(std::int64_t noticed_at) noexcept;
  void send_sync() noexcept;
  void start_nodes() noexcept;
  void miss_deadline() noexcept;
  std::int32_t starved_periods(std::int64_t woken_at) noexcept;
  std::int64_t bus_now() const noexcept;
  void sleep_until(std::int64_t instant) const noexcept;
  void come_to_rest() noexcept;

  void collect_commands() noexcept;
  control::OperatorAction take_action() noexcept;
  const control::ReferenceTrajectory* take_reference() noexcept;
  void forget_pending(std::size_t index) noexcept;
  void forget_arming() noexcept;

  const control::ControllerConfig& config_;
  const LoopSettings settings_;
  const std::int64_t period_ns_;
  const std::int64_t timeout_periods_;  // safety.encoder_timeout_s
  control::ControlCycle cycle_;
  MonitoredBus bus_;

  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> turns_{0};
  std::int64_t next_cycle_ = 0;
  std::int64_t late_until_ =
      0;  // CLOCK_MONOTONIC: a frame before it belongs to a period that is over
  bool frame_ever_seen_ = false;
  std::int32_t new_overruns_ = 0;    // since the last cycle
  std::int64_t last_cycle_at_ = -1;  // CLOCK_MONOTONIC: its thread woke up; -1: no cycle yet
  control::Frame last_frame_;
  std::uint64_t sync_counter_ = 0;

  static constexpr std::size_t kMaxPending = 2 * kMaxScheduled;
  std::array<LoopCommand, kMaxPending> pending_{};
  std::size_t pending_count_ = 0;
  std::uint64_t executed_command_ = 0;
  std::atomic<std::int64_t> scheduled_done_{0};
  control::ReferenceTrajectory reference_{};  // as handed over last; its table is in use

  CommandQueue commands_;
  LoopRecordQueue records_;
  ReleasedTableQueue released_tables_;
  Snapshot<LoopRecord> newest_;
  CounterCells cells_;
  LatencyHistogram arrival_to_sent_;
};

}  // namespace eampc::realtime
