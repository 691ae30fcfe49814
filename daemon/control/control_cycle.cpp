#include "control/control_cycle.hpp"

#include <algorithm>
#include <utility>

namespace eampc::control {

ControlCycle::ControlCycle(const ControllerConfig& config) noexcept
    : config_(config),
      encoder_codec_(config.encoder),
      monitor_codec_(config),
      state_estimator_(config),
      disturbance_estimator_(config),
      explicit_law_(config),
      safety_(config),
      valve_codec_(config.valve_command) {}

Mode ControlCycle::mode() const noexcept { return safety_.state().mode; }

bool ControlCycle::at_rest() const noexcept {
  const Mode now = mode();
  return now == Mode::kInit || now == Mode::kDisarmed || now == Mode::kFault;
}

// No further than a gap is believed: an encoder may be off for months.
void ControlCycle::count_silent_period() noexcept {
  constexpr auto kMost = static_cast<std::int32_t>(kLongestCounterGap);
  periods_without_sample_ = std::min(periods_without_sample_ + 1, kMost);
}

std::int32_t ControlCycle::elapsed_periods(const EncoderSample& sample) noexcept {
  if (sample.verdict == SampleVerdict::kDuplicate) {
    // The bus may repeat a frame once, and no period passed; an encoder that repeats itself for
    // longer is frozen.
    if (!duplicate_before_) {
      duplicate_before_ = true;
      return 0;
    }
    count_silent_period();
    return 1;
  }
  duplicate_before_ = false;
  if (sample.verdict != SampleVerdict::kValid) {
    count_silent_period();
    return 1;
  }
  // The encoder's counter is the time base: a period that was reported as empty and whose frame
  // came late after all is not counted again. After a silence as long as the time-out, or without a
  // counter, it says nothing.
  const auto lost =
      static_cast<std::int32_t>(std::min<std::uint32_t>(sample.missed_frames, kLongestCounterGap));
  const bool counter_tells = config_.encoder.counter.present &&
                             static_cast<double>(periods_without_sample_) * config_.model.period_s <
                                 config_.safety.encoder_timeout_s;
  const std::int32_t silent = std::exchange(periods_without_sample_, 0);
  if (!counter_tells) {
    periods_ahead_ = 0;
    return 1 + std::max(0, lost - silent);
  }
  const std::int32_t due = 1 + lost - silent - periods_ahead_;
  periods_ahead_ = std::max(0, -due);
  return std::max(0, due);
}

// After so long a silence the counter tells nothing: one that stands where it stood has gone round.
std::int32_t ControlCycle::end_starvation(EncoderSample& sample,
                                          std::int32_t starved_periods) noexcept {
  if (sample.verdict == SampleVerdict::kDuplicate) sample.verdict = SampleVerdict::kMissing;
  periods_ahead_ = 0;
  constexpr auto kMost = static_cast<std::int32_t>(kLongestCounterGap);
  const std::int32_t starved = std::min(starved_periods, kMost);
  const std::int32_t told = elapsed_periods(sample);
  if (sample.verdict != SampleVerdict::kValid) {
    periods_without_sample_ = std::min(periods_without_sample_ + starved, kMost);
  }
  return std::max(told, 1 + starved);
}

CycleOutput ControlCycle::step(const CycleInput& input) noexcept EAMPC_NONBLOCKING {
  if (input.new_reference != nullptr) {
    trajectory_ = *input.new_reference;
  }
  EncoderSample sample = encoder_codec_.decode(input.encoder_frame);
  const std::int32_t elapsed = input.starved_periods > 0
                                   ? end_starvation(sample, input.starved_periods)
                                   : elapsed_periods(sample);
  const MonitorSample monitor = monitor_codec_.take();
  const SafetyState charge = safety_.advance({monitor, input.bus, input.action, elapsed}, sample);
  cycle_ += elapsed;

  // A refused command left the one before it on the valves.
  u_on_valves_ = input.bus.send_refused ? u_on_valves_ : u_sent_;
  for (std::int32_t period = 0; period < elapsed; ++period) {
    disturbance_estimator_.predict(u_on_valves_);
    state_estimator_.predict(u_on_valves_, disturbance_estimator_.for_prediction());
  }
  if (charge.law_begins) {
    disturbance_estimator_.law_begins();
  }

  CycleOutput output;
  CycleRecord& record = output.record;
  record.cycle = std::max<std::int64_t>(cycle_, 0);
  record.scenario_time_s = charge.scenario_time_s;
  record.sample = sample;
  record.pressure1_kPa = monitor.pressure1_kPa;
  record.pressure2_kPa = monitor.pressure2_kPa;
  record.supply_pressure_kPa = monitor.supply_pressure_kPa;
  record.bus = input.bus;
  predicted_ |= elapsed > 0;
  // A sample corrects the prediction for its own instant, once.
  if (predicted_ && (elapsed > 0 || sample.verdict == SampleVerdict::kValid)) {
    predicted_ = sample.verdict != SampleVerdict::kValid;
    state_ = state_estimator_.correct(sample);
    disturbance_ = disturbance_estimator_.update(state_);
  }
  record.state = state_;
  record.disturbance = disturbance_;

  const bool reference_clamped =
      read_reference(std::max(0.0, charge.scenario_time_s), record.reference);
  if (charge.mode != Mode::kActive) {
    // Before ACTIVE the law holds the joint where the reference will begin.
    record.reference.velocity_rad_s = 0.0;
    record.reference.acceleration_rad_s2 = 0.0;
  }
  if (charge.law_acts) {
    record.law = explicit_law_.decide(record.state, record.disturbance, record.reference);
  }
  const SafetyDecision decision = safety_.decide(record.state, record.disturbance, record.law);
  const EncodedCommand command = valve_codec_.encode(decision.demand);
  safety_.sent(command.sent);
  u_sent_ = command.sent.enable
                ? (command.sent.u1_V - command.sent.u2_V) / (2.0 * config_.valve.control_gain_V)
                : 0.0;

  output.command = command.frame;
  record.valves = command.sent;
  const SafetyState after = safety_.state();
  record.mode = after.mode;
  record.fault = after.fault;
  record.present_faults = after.present_faults;
  record.refusal = after.refusal;
  record.refusal_cause = after.refusal_cause;
  record.limits = decision.limits | (reference_clamped ? kLimitReferenceRange : kLimitNone);
  return output;
}

bool ControlCycle::read_reference(double time_s, Reference& reference) const noexcept {
  const LawConfig& law = config_.law;
  if (law.formulation == Formulation::kPaper && !law.reference_is_parameter) {
    reference = {law.fixed_reference_rad, 0.0, 0.0};
    return false;
  }
  reference = reference_at(trajectory_, time_s);
  return clamp_reference(reference, config_.safety.reference_angle_max_rad);
}

}  // namespace eampc::control
