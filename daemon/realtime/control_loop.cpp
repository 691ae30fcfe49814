#include "realtime/control_loop.hpp"

#include <poll.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <utility>

#include "control/frame_codec.hpp"
#include "control/period_count.hpp"
#include "realtime/kernel_stamp.hpp"

namespace eampc::realtime {
namespace {

// How long the loop may sit in poll() before it looks at the stop flag: 20 ms, unnoticed by people.
constexpr std::int64_t kStopCheckNs = 20'000'000;
// poll() keeps reporting an error on a dead descriptor; at a real-time priority that must not
// become a busy loop: 1 ms is 1,000 turns a second.
constexpr std::int64_t kErrorPauseNs = 1'000'000;
// Frames read in one go: a flooded bus must not keep the loop from its deadline.
constexpr int kMaxDrain = 64;
// How long the last frame may wait for the one before it: as long as 40 frames need at 250 kbit/s.
constexpr std::int64_t kLastFrameWaitNs = 20'000'000;
// A kernel stamp further back than this is a stepped clock, not a latency.
constexpr std::int64_t kMaxPlausibleLatencyNs = kNanosecondsPerSecond;

std::int64_t now_ns(clockid_t clock) noexcept {
  timespec now{};
  ::clock_gettime(clock, &now);
  return now.tv_sec * kNanosecondsPerSecond + now.tv_nsec;
}

timespec to_timespec(std::int64_t ns) noexcept {
  return {static_cast<time_t>(ns / kNanosecondsPerSecond),
          static_cast<long>(ns % kNanosecondsPerSecond)};
}

double to_us(std::int64_t ns) noexcept { return 1e-3 * static_cast<double>(ns); }

void count(std::atomic<std::int64_t>& cell, std::int64_t by = 1) noexcept {
  cell.store(cell.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
}

}  // namespace

ControlLoop::ControlLoop(Bus& bus, const control::ControllerConfig& config, LoopSettings settings)
    : config_(config),
      settings_(settings),
      period_ns_(std::llround(config.model.period_s * static_cast<double>(kNanosecondsPerSecond))),
      timeout_periods_(
          std::max(1, control::periods_in(config.safety.encoder_timeout_s, config.model.period_s))),
      cycle_(config),
      bus_(bus, period_ns_) {
  LoopRecord first;
  first.cycle.cycle = -1;
  first.cycle.mode = cycle_.mode();
  first.at_rest = cycle_.at_rest();
  newest_.write(first);
}

void ControlLoop::request_stop() noexcept { stop_.store(true, std::memory_order_relaxed); }

LoopCounters ControlLoop::counters() const noexcept {
  const auto read = [](const std::atomic<std::int64_t>& cell) {
    return cell.load(std::memory_order_relaxed);
  };
  const BusReport bus = bus_.report();
  return {.cycles = read(cells_.cycles),
          .encoder_frames = read(cells_.encoder_frames),
          .valid_frames = read(cells_.valid_frames),
          .encoder_timeouts = read(cells_.encoder_timeouts),
          .superseded_frames = read(cells_.superseded_frames),
          .late_frames = read(cells_.late_frames),
          .duplicate_frames = read(cells_.duplicate_frames),
          .invalid_frames = read(cells_.invalid_frames),
          .deadline_overruns = read(cells_.deadline_overruns),
          .send_errors = bus.send_errors,
          .confirmed_frames = bus.confirmed_frames,
          .ignored_frames = bus.ignored_frames,
          .error_frames = bus.error_frames,
          .link_downs = bus.link_downs,
          .receive_overflows = read(cells_.receive_overflows),
          .telemetry_dropped = static_cast<std::int64_t>(records_.dropped())};
}

void ControlLoop::run() noexcept EAMPC_NONBLOCKING {
  start_nodes();
  if (config_.trigger_on_sync && !settings_.lockstep) {
    run_on_sync();
  } else {
    run_on_encoder();
  }
  come_to_rest();
}

void ControlLoop::run_on_encoder() noexcept {
  constexpr std::int64_t kNoDeadline = 0;
  std::int64_t deadline = kNoDeadline;
  while (!stop_.load(std::memory_order_relaxed)) {
    Arrival arrival;
    switch (wait_for_frame(deadline, arrival)) {
      case Wait::kStop:
        return;
      case Wait::kFrame:
        if (!settings_.lockstep) {
          deadline = arrival.arrived_at + period_ns_ + period_ns_ / 2;
          if (frame_ever_seen_ && arrival.arrived_at < late_until_) {
            const bool duplicate = arrival.received.frame.data == last_frame_.data;
            count(duplicate ? cells_.duplicate_frames : cells_.late_frames);
            break;
          }
        }
        late_until_ = arrival.arrived_at + period_ns_ / 2;
        run_cycle(&arrival.received.frame, arrival);
        break;
      case Wait::kDeadline:
        count(cells_.encoder_timeouts);
        // The next frame is due half a period from now: half of that is for what is late, half for
        // jitter (a USB adapter's is ±0.9 ms).
        late_until_ = deadline + period_ns_ / 4;
        run_cycle_without_frame(deadline);
        deadline += period_ns_;
        // No catching up: periods the thread slept through are gone.
        for (const std::int64_t now = now_ns(CLOCK_MONOTONIC); deadline <= now;
             deadline += period_ns_) {
          count(cells_.encoder_timeouts);
          miss_deadline();
        }
        break;
    }
  }
}

void ControlLoop::run_on_sync() noexcept {
  std::int64_t grid = now_ns(CLOCK_MONOTONIC) + period_ns_;
  while (!stop_.load(std::memory_order_relaxed)) {
    sleep_until(grid);
    discard_waiting_frames();  // what came before the Sync does not answer it
    send_sync();
    Arrival arrival;
    // An eighth is left for the cycle and its frame: 0.6 ms at 200 Hz; 8 bytes take 0.27 ms at
    // 500 kbit/s.
    const std::int64_t deadline = grid + period_ns_ - period_ns_ / 8;
    switch (wait_for_frame(deadline, arrival)) {
      case Wait::kStop:
        return;
      case Wait::kFrame:
        run_cycle(&arrival.received.frame, arrival);
        break;
      case Wait::kDeadline:
        if (frame_ever_seen_) {
          count(cells_.encoder_timeouts);
          run_cycle_without_frame(deadline);
        }
        break;
    }
    grid += period_ns_;
    for (const std::int64_t now = now_ns(CLOCK_MONOTONIC); grid < now; grid += period_ns_) {
      miss_deadline();
    }
  }
}

ControlLoop::Wait ControlLoop::wait_for_frame(std::int64_t deadline, Arrival& arrival) noexcept {
  for (;;) {
    turns_.store(turns() + 1, std::memory_order_relaxed);
    if (stop_.load(std::memory_order_relaxed)) return Wait::kStop;
    const std::int64_t now = now_ns(CLOCK_MONOTONIC);
    bus_.reopen_if_gone(now);
    const std::int64_t remaining =
        deadline == 0 ? kStopCheckNs : std::clamp<std::int64_t>(deadline - now, 0, kStopCheckNs);
    const timespec limit = to_timespec(remaining);
    pollfd descriptor{bus_.fd(), POLLIN, 0};
    const int ready = ::ppoll(&descriptor, 1, &limit, nullptr);
    // Frames first, the deadline second: a thread that wakes late still uses what has arrived.
    if (ready > 0 && take_frame(arrival)) return Wait::kFrame;
    if (deadline != 0 && now_ns(CLOCK_MONOTONIC) >= deadline) return Wait::kDeadline;
    if (ready > 0 && (descriptor.revents & (POLLERR | POLLHUP | POLLNVAL)) != 0) {
      const timespec pause = to_timespec(kErrorPauseNs);
      ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
    }
  }
}

bool ControlLoop::take_frame(Arrival& arrival) noexcept {
  bool found = false;
  const std::int64_t now = bus_now();
  const std::int64_t realtime_ns = now_ns(CLOCK_REALTIME);
  for (int i = 0; i < kMaxDrain; ++i) {
    ReceivedFrame received;
    const BusEvent event = bus_.receive(received, now);
    if (event == BusEvent::kNothing) break;
    if (event == BusEvent::kMonitored) {
      cycle_.observe(received.frame);
      if (cycle_.asks_for_start(received.frame)) start_nodes();
    }
    if (event != BusEvent::kFrame) continue;
    count(cells_.encoder_frames);
    if (found) {
      const bool duplicate = received.frame.data == arrival.received.frame.data;
      count(duplicate ? cells_.duplicate_frames : cells_.superseded_frames);
      const std::int64_t stamp = arrival.received.arrival_ns;
      const std::int64_t waited = realtime_ns - stamp;
      const bool missed = stamp != 0 && waited > period_ns_ && waited < kMaxPlausibleLatencyNs;
      if (frame_ever_seen_ && missed) miss_deadline();
    }
    arrival.received = received;
    found = true;
    if (settings_.lockstep) break;  // never leave one out
  }
  if (!found) return false;

  arrival.woken_at = now_ns(CLOCK_MONOTONIC);
  const std::int64_t woken_ns = now_ns(CLOCK_REALTIME);
  const std::int64_t latency = woken_ns - arrival.received.arrival_ns;
  const bool plausible =
      arrival.received.arrival_ns != 0 && latency >= 0 && latency < kMaxPlausibleLatencyNs;
  arrival.arrival_ns = plausible ? arrival.received.arrival_ns : woken_ns;
  arrival.arrived_at = arrival.woken_at - (plausible ? latency : 0);
  return true;
}

void ControlLoop::discard_waiting_frames() noexcept {
  Arrival arrival;
  if (take_frame(arrival)) count(cells_.late_frames);
}

void ControlLoop::run_cycle_without_frame(std::int64_t noticed_at) noexcept {
  Arrival arrival;
  arrival.woken_at = now_ns(CLOCK_MONOTONIC);
  arrival.arrived_at = noticed_at;
  arrival.arrival_ns = now_ns(CLOCK_REALTIME) - (arrival.woken_at - noticed_at);
  run_cycle(nullptr, arrival);
}

void ControlLoop::run_cycle(const control::Frame* frame, const Arrival& arrival) noexcept {
  collect_commands();
  control::CycleInput input;
  input.encoder_frame = frame;
  input.action = take_action();
  input.new_reference = take_reference();
  const std::int64_t bus_instant = bus_now();
  input.bus = bus_.take_health(bus_instant);
  input.bus.deadline_overruns = std::exchange(new_overruns_, 0);
  input.starved_periods = starved_periods(arrival.woken_at);
  const control::CycleOutput output = cycle_.step(input);
  const std::int64_t decided_at = now_ns(CLOCK_MONOTONIC);

  bus_.command({output.command, output.record.valves.enable}, bus_instant);
  const std::int64_t sent_at = now_ns(CLOCK_MONOTONIC);

  if (output.record.fault != control::Fault::kNone) forget_arming();
  next_cycle_ =
      output.record.cycle + 1;  // the cycle counts frames that were lost, and not a repeated one
  count(cells_.cycles);
  cells_.receive_overflows.store(bus_.receive_overflows(), std::memory_order_relaxed);

  LoopRecord record;
  record.cycle = output.record;
  record.frame_seen = frame != nullptr;
  record.at_rest = cycle_.at_rest();
  record.executed_command = executed_command_;
  record.arrival_ns = arrival.arrival_ns;
  record.arrival_to_wake_us = to_us(arrival.woken_at - arrival.arrived_at);
  record.wake_to_decided_us = to_us(decided_at - arrival.woken_at);
  record.decided_to_sent_us = to_us(sent_at - decided_at);
  record.arrival_to_sent_us = to_us(sent_at - arrival.arrived_at);
  if (frame != nullptr) {
    frame_ever_seen_ = true;
    last_frame_ = *frame;
    switch (output.record.sample.verdict) {
      case control::SampleVerdict::kValid:
        count(cells_.valid_frames);
        break;
      case control::SampleVerdict::kDuplicate:
        count(cells_.duplicate_frames);
        break;
      default:
        count(cells_.invalid_frames);
        break;
    }
    arrival_to_sent_.add(record.arrival_to_sent_us);
    if (!settings_.lockstep && sent_at - arrival.arrived_at > period_ns_) {
      miss_deadline();
    }
  }
  bus_.publish(bus_instant);
  newest_.write(record);
  if (settings_.lockstep) {
    while (!records_.has_room() && !stop_.load(std::memory_order_relaxed)) {
      const timespec pause = to_timespec(kErrorPauseNs);
      ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
    }
  }
  records_.push(record);
}

void ControlLoop::miss_deadline() noexcept {
  count(cells_.deadline_overruns);
  ++new_overruns_;
}

// The slack is what a trigger leaves between two cycles of neighbouring periods: a frame is given
// up half a period after its instant, an answer to a Sync may come anywhere in its period.
std::int32_t ControlLoop::starved_periods(std::int64_t woken_at) noexcept {
  const std::int64_t last = std::exchange(last_cycle_at_, woken_at);
  if (settings_.lockstep || last < 0) return 0;
  const std::int64_t slack = config_.trigger_on_sync ? period_ns_ : period_ns_ / 2;
  const std::int64_t starved = (woken_at - last - slack) / period_ns_;
  if (starved < timeout_periods_) return 0;
  constexpr std::int64_t kMost = 1'000'000;
  return static_cast<std::int32_t>(std::min(starved, kMost));
}

void ControlLoop::send_sync() noexcept {
  if (!config_.sync.present) return;
  control::Frame frame;
  frame.id = config_.sync.id;
  frame.extended = config_.sync.extended;
  frame.length = static_cast<std::uint8_t>(config_.sync.length);
  if (config_.sync.counter.present) {
    control::insert_bits(frame.data, config_.sync.counter, sync_counter_++);
  }
  bus_.sync(frame, bus_now());
}

void ControlLoop::start_nodes() noexcept {
  if (config_.node_start.present) bus_.sync(config_.node_start.frame, bus_now());
}

// In lock-step the frames are the time, here as everywhere.
std::int64_t ControlLoop::bus_now() const noexcept {
  return settings_.lockstep ? cells_.cycles.load(std::memory_order_relaxed) * period_ns_
                            : now_ns(CLOCK_MONOTONIC);
}

void ControlLoop::sleep_until(std::int64_t instant) const noexcept {
  const timespec wake = to_timespec(instant);
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr) == EINTR) {
  }
}

// Whoever stops the loop has waited for the soft stop; where no cycles came any more (a lock-step
// plant that ended) the stop's ramp is stepped through here. The last frame on the bus always is
// the safe one.
void ControlLoop::come_to_rest() noexcept {
  // The longest stop: a hold (`saturate`), to the bias, to the safe voltage; a second for the rest.
  const double ramps_s =
      3.0 * config_.safety.soft_stop_ramp_s + config_.safety.encoder_timeout_s + 1.0;
  const auto bound = static_cast<std::int64_t>(std::ceil(ramps_s / config_.model.period_s));
  control::CycleInput input;
  input.action = control::OperatorAction::kDisarm;
  control::CycleOutput output = cycle_.step(input);
  input.action = control::OperatorAction::kNone;
  for (std::int64_t i = 0; i < bound && !cycle_.at_rest(); ++i) output = cycle_.step(input);
  Arrival unused;
  for (const std::int64_t limit = now_ns(CLOCK_MONOTONIC) + kLastFrameWaitNs;
       bus_.in_flight() && now_ns(CLOCK_MONOTONIC) < limit;) {
    const timespec pause = to_timespec(kErrorPauseNs);
    ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
    take_frame(unused);
  }
  bus_.last_command({output.command, output.record.valves.enable}, bus_now());
  bus_.publish(bus_now());

  LoopRecord record;
  record.cycle = output.record;
  record.at_rest = cycle_.at_rest();
  record.executed_command = executed_command_;
  record.arrival_ns = now_ns(CLOCK_REALTIME);
  newest_.write(record);
}

void ControlLoop::collect_commands() noexcept {
  while (pending_count_ < pending_.size() && commands_.pop(pending_[pending_count_]))
    ++pending_count_;
}

void ControlLoop::forget_pending(std::size_t index) noexcept {
  const LoopCommand& command = pending_[index];
  if (command.at_cycle < 0) {
    executed_command_ = std::max(executed_command_, command.id);
  } else {
    count(scheduled_done_);
  }
  for (std::size_t i = index + 1; i < pending_count_; ++i) pending_[i - 1] = pending_[i];
  --pending_count_;
}

// After a fault or a disarm nothing arms that was ordered before it: up only by a new edge.
void ControlLoop::forget_arming() noexcept {
  for (std::size_t i = pending_count_; i-- > 0;) {
    if (pending_[i].action == control::OperatorAction::kArm) forget_pending(i);
  }
}

control::OperatorAction ControlLoop::take_action() noexcept {
  using control::OperatorAction;
  const auto is_due = [&](const LoopCommand& command) { return command.at_cycle <= next_cycle_; };
  for (std::size_t i = 0; i < pending_count_; ++i) {
    if (pending_[i].action != OperatorAction::kDisarm || !is_due(pending_[i])) continue;
    // Whoever stops the machine means every arming that still waits, too.
    forget_arming();
    for (std::size_t j = pending_count_; j-- > 0;) {
      if (pending_[j].action == OperatorAction::kDisarm && is_due(pending_[j])) forget_pending(j);
    }
    return OperatorAction::kDisarm;
  }
  for (std::size_t i = 0; i < pending_count_; ++i) {
    const OperatorAction action = pending_[i].action;
    if (action == OperatorAction::kNone || !is_due(pending_[i])) continue;
    forget_pending(i);
    return action;
  }
  return OperatorAction::kNone;
}

const control::ReferenceTrajectory* ControlLoop::take_reference() noexcept {
  bool taken = false;
  for (std::size_t i = 0; i < pending_count_;) {
    if (!pending_[i].has_reference || pending_[i].at_cycle > next_cycle_) {
      ++i;
      continue;
    }
    // The cycle copies the trajectory but reads the table in place: only the replaced one goes
    // back.
    if (reference_.table != nullptr) released_tables_.push(reference_.table);
    reference_ = pending_[i].reference;
    forget_pending(i);
    taken = true;
  }
  return taken ? &reference_ : nullptr;
}

}  // namespace eampc::realtime
