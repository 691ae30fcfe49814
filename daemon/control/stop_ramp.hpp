// The way down. In: where the voltages are, how to stop, periods passed → out: both voltages (V).
// Phases of safety.soft_stop_ramp_s each: hold (saturate only), to valve.bias_V (not for
// vent_ramp), to valve.safe_V. Cost: constant. Absent: why, and where a soft stop would raise a
// voltage (mode_machine); the immediate stop, which has no way.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

class StopRamp {
 public:
  explicit StopRamp(const ControllerConfig& config) noexcept;

  // `action`: not kImmediate.
  void begin(StopAction action, const ValveVoltages& last) noexcept;
  void advance(std::int32_t elapsed_periods) noexcept;

  bool done() const noexcept { return done_; }
  // The phase as the action that would begin with it.
  StopAction phase() const noexcept { return phase_; }
  ValveVoltages voltages() const noexcept;

 private:
  void enter_phases() noexcept;

  const ControllerConfig& config_;
  const std::int32_t phase_periods_;
  StopAction phase_ = StopAction::kSoftStop;
  bool done_ = false;
  std::int32_t period_ = 0;  // of the phase, 1 in its first cycle
  ValveVoltages start_;
};

}  // namespace eampc::control
