#include "control/safety.hpp"

#include <algorithm>
#include <cmath>

namespace eampc::control {
namespace {

// A frame may still be refused once (a full transmit queue); the design calls a command that stays
// unsent for two periods a fault.
constexpr std::int32_t kRefusedFramesMax = 2;

std::int32_t periods(double duration_s, double period_s) noexcept {
  return static_cast<std::int32_t>(std::round(duration_s / period_s));
}

double share(double start, double target, std::int32_t done, std::int32_t of) noexcept {
  if (done >= of) {
    return target;
  }
  return start + (target - start) * static_cast<double>(done) / static_cast<double>(of);
}

}  // namespace

Safety::Safety(const ControllerConfig& config) noexcept
    : config_(config),
      arming_periods_(periods(config.safety.arming_ramp_s, config.model.period_s)),
      stop_periods_(periods(config.safety.soft_stop_ramp_s, config.model.period_s)),
      timeout_periods_(
          std::max(1, periods(config.safety.encoder_timeout_s, config.model.period_s))),
      ramp_start_{config.valve.safe_V, config.valve.safe_V, false},
      last_{config.valve.safe_V, config.valve.safe_V, false} {}

SafetyState Safety::state() const noexcept {
  return {mode_, fault_, entered_active_,
          mode_ == Mode::kActive ? static_cast<double>(active_periods_) * config_.model.period_s
                                 : -1.0};
}

bool Safety::moving() const noexcept {
  return mode_ == Mode::kArming || mode_ == Mode::kActive || mode_ == Mode::kSoftStop;
}

Fault Safety::fault_of_silence() const noexcept {
  switch (verdict_since_sample_) {
    case SampleVerdict::kBadCrc:
      return Fault::kEncoderCrc;
    case SampleVerdict::kWrongLength:
      return Fault::kEncoderLength;
    case SampleVerdict::kOutOfRange:
      return Fault::kEncoderOutOfRange;
    case SampleVerdict::kDuplicate:
      return Fault::kEncoderFrozen;
    case SampleVerdict::kValid:
    case SampleVerdict::kMissing:
    case SampleVerdict::kJump:
      break;
  }
  return Fault::kEncoderTimeout;
}

void Safety::raise(Fault fault) noexcept {
  const StopAction action = config_.safety.actions[fault];
  if (fault_ == Fault::kNone) {
    fault_ = fault;
  } else if (action != StopAction::kImmediate) {
    return;  // the first cause and its ramp stand until reset; only an immediate stop cuts in
  }
  const bool already_stopping = mode_ == Mode::kSoftStop;
  switch (action) {
    case StopAction::kSaturate:
      if (!already_stopping) begin_stop(Phase::kHold);
      break;
    case StopAction::kSoftStop:
      if (!already_stopping) begin_stop(mode_ == Mode::kArming ? Phase::kVent : Phase::kToBias);
      break;
    case StopAction::kVentRamp:
      if (!already_stopping) begin_stop(Phase::kVent);
      break;
    case StopAction::kImmediate:
      mode_ = Mode::kFault;
      break;
  }
}

void Safety::begin_stop(Phase phase) noexcept {
  mode_ = Mode::kSoftStop;
  phase_ = phase;
  ramp_start_ = last_;
  ramp_period_ = 1;
  continue_stop();
}

void Safety::continue_stop() noexcept {
  while (ramp_period_ > stop_periods_) {
    ramp_period_ -= stop_periods_;
    if (phase_ == Phase::kHold) {
      phase_ = Phase::kToBias;
      ramp_start_ = last_;
    } else if (phase_ == Phase::kToBias) {
      phase_ = Phase::kVent;
      ramp_start_ = {config_.valve.bias_V, config_.valve.bias_V, true};
    } else {
      mode_ = fault_ == Fault::kNone ? Mode::kDisarmed : Mode::kFault;
      return;
    }
  }
}

void Safety::obey(OperatorAction action) noexcept {
  switch (action) {
    case OperatorAction::kArm:
      if (mode_ == Mode::kDisarmed && periods_without_sample_ < timeout_periods_ &&
          refused_frames_ == 0) {
        mode_ = Mode::kArming;
        ramp_start_ = last_;
        ramp_period_ = 1;
      }
      break;
    case OperatorAction::kDisarm:
      if (mode_ == Mode::kActive) {
        begin_stop(Phase::kToBias);
      } else if (mode_ == Mode::kArming) {
        begin_stop(Phase::kVent);  // up to the bias first would add pressure on the way down
      }
      break;
    case OperatorAction::kReset:
      if (mode_ == Mode::kFault) {
        mode_ = Mode::kDisarmed;
        fault_ = Fault::kNone;
      }
      break;
    case OperatorAction::kNone:
      break;
  }
}

SafetyState Safety::advance(const SafetyInput& input) noexcept {
  entered_active_ = false;
  same_period_ = input.elapsed_periods == 0;
  // Frames that only the counter misses were a silence like any other.
  const bool ends_a_silence =
      input.verdict == SampleVerdict::kValid &&
      periods_without_sample_ + input.elapsed_periods - 1 >= timeout_periods_;
  if (input.verdict == SampleVerdict::kValid) {
    periods_without_sample_ = 0;
    verdict_since_sample_ = SampleVerdict::kMissing;
    if (mode_ == Mode::kInit) {
      mode_ = Mode::kDisarmed;
    }
  } else {
    periods_without_sample_ =
        std::min(periods_without_sample_ + input.elapsed_periods, timeout_periods_);
    if (input.verdict != SampleVerdict::kMissing) verdict_since_sample_ = input.verdict;
  }
  refused_frames_ = input.bus.send_refused ? std::min(refused_frames_ + 1, kRefusedFramesMax) : 0;

  if (mode_ == Mode::kActive) {
    active_periods_ += input.elapsed_periods;
  } else if (mode_ == Mode::kArming) {
    ramp_period_ += input.elapsed_periods;
  } else if (mode_ == Mode::kSoftStop) {
    ramp_period_ += input.elapsed_periods;
    continue_stop();
  }

  if (moving()) {
    if (refused_frames_ >= kRefusedFramesMax) {
      raise(Fault::kSendRefused);
    } else if (periods_without_sample_ >= timeout_periods_) {
      raise(fault_of_silence());
    } else if (ends_a_silence) {
      raise(Fault::kEncoderTimeout);
    }
  }
  obey(input.action);
  if (mode_ == Mode::kArming && ramp_period_ > arming_periods_) {
    mode_ = Mode::kActive;
    entered_active_ = true;
    active_periods_ = ramp_period_ - arming_periods_ - 1;
  }
  return state();
}

ValveVoltages Safety::ramp_towards(double target_V, std::int32_t of) const noexcept {
  return {share(ramp_start_.u1_V, target_V, ramp_period_, of),
          share(ramp_start_.u2_V, target_V, ramp_period_, of), true};
}

ValveVoltages Safety::stop_voltages() const noexcept {
  switch (phase_) {
    case Phase::kHold:
      return {ramp_start_.u1_V, ramp_start_.u2_V, true};
    case Phase::kToBias:
      return ramp_towards(config_.valve.bias_V, stop_periods_);
    case Phase::kVent:
      return ramp_towards(config_.valve.safe_V, stop_periods_);
  }
  return {config_.valve.safe_V, config_.valve.safe_V, true};
}

SafetyDecision Safety::decide(const StateEstimate& state, const DisturbanceEstimate& disturbance,
                              const LawOutput& law) noexcept {
  const ValveConfig& valve = config_.valve;
  SafetyDecision decision;
  if (mode_ == Mode::kActive) {
    bool finite = std::isfinite(law.u);
    for (const double x : state.x) finite &= std::isfinite(x);
    for (const double d : disturbance.for_law) finite &= std::isfinite(d);
    if (!finite) {
      raise(Fault::kNotFinite);
    }
  }
  // A second command in one period must not double the rate: it stays within one step of the
  // period's beginning as well as of the command before it. From a disabled node there is no step.
  if (!same_period_ || !last_.enable) period_start_ = last_;
  ValveVoltages& wanted = decision.demand.voltages;
  switch (mode_) {
    case Mode::kActive:
      wanted = {valve.bias_V + valve.control_gain_V * law.u,
                valve.bias_V - valve.control_gain_V * law.u, true};
      if (law.at_range_end) decision.limits |= kLimitControlRange;
      if (law.parameter_clamped) decision.limits |= kLimitParameterBox;
      break;
    case Mode::kArming:
      wanted = ramp_towards(valve.bias_V, arming_periods_);
      break;
    case Mode::kSoftStop:
      wanted = stop_voltages();
      break;
    case Mode::kInit:
    case Mode::kDisarmed:
    case Mode::kFault:
      wanted = {valve.safe_V, valve.safe_V, false};
      decision.demand.u1 = {valve.min_V, valve.max_V};
      decision.demand.u2 = {valve.min_V, valve.max_V};
      return decision;
  }

  const double slew_V = valve.slew_max_V_per_s * config_.model.period_s;
  const auto guard = [&](double& voltage_V, double start_V, double last_V,
                         VoltageWindow& window) noexcept {
    if (!std::isfinite(voltage_V)) {
      voltage_V = last_V;  // unreachable after the check above; kept because it is the last line
                           // before the wire
    }
    if (voltage_V < valve.min_V || voltage_V > valve.max_V) {
      decision.limits |= kLimitControlRange;
      voltage_V = std::clamp(voltage_V, valve.min_V, valve.max_V);
    }
    window = {std::max(valve.min_V, std::max(start_V, last_V) - slew_V),
              std::min(valve.max_V, std::min(start_V, last_V) + slew_V)};
    if (voltage_V < window.lower_V || voltage_V > window.upper_V) {
      decision.limits |= kLimitSlewRate;
      voltage_V = std::clamp(voltage_V, window.lower_V, window.upper_V);
    }
  };
  guard(wanted.u1_V, period_start_.u1_V, last_.u1_V, decision.demand.u1);
  guard(wanted.u2_V, period_start_.u2_V, last_.u2_V, decision.demand.u2);
  return decision;
}

}  // namespace eampc::control
