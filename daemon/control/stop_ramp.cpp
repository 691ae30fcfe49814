#include "control/stop_ramp.hpp"

#include "control/period_count.hpp"
#include "control/voltage_ramp.hpp"

namespace eampc::control {

StopRamp::StopRamp(const ControllerConfig& config) noexcept
    : config_(config),
      phase_periods_(periods_in(config.safety.soft_stop_ramp_s, config.model.period_s)) {}

void StopRamp::begin(StopAction action, const ValveVoltages& last) noexcept {
  phase_ = action;
  done_ = false;
  start_ = last;
  period_ = 1;
  enter_phases();
}

void StopRamp::advance(std::int32_t elapsed_periods) noexcept {
  period_ += elapsed_periods;
  enter_phases();
}

void StopRamp::enter_phases() noexcept {
  while (!done_ && period_ > phase_periods_) {
    period_ -= phase_periods_;
    if (phase_ == StopAction::kSaturate) {
      phase_ = StopAction::kSoftStop;  // from the voltages that were held
    } else if (phase_ == StopAction::kSoftStop) {
      phase_ = StopAction::kVentRamp;
      start_ = {config_.valve.bias_V, config_.valve.bias_V, true};
    } else {
      done_ = true;
    }
  }
}

ValveVoltages StopRamp::voltages() const noexcept {
  switch (phase_) {
    case StopAction::kSaturate:
      return {start_.u1_V, start_.u2_V, true};
    case StopAction::kSoftStop:
      return on_ramp(start_, config_.valve.bias_V, period_, phase_periods_);
    case StopAction::kVentRamp:
    case StopAction::kImmediate:
      break;
  }
  return on_ramp(start_, config_.valve.safe_V, period_, phase_periods_);
}

}  // namespace eampc::control
