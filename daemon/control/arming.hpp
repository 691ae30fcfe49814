// The way up, bumpless. In: periods passed → out: how far it is. First both voltages ramp from
// where they are to valve.bias_V in safety.arming_ramp_s, then the law acts within reduced limits
// for safety.reduced_limits_s (mode ARMING still, the reference held), then ACTIVE begins. Either
// time may be 0. Cost: constant. Absent: who may start it (mode_machine), the reduced limits
// themselves (safety).
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

// Periods from the operator's edge to the first of ACTIVE.
std::int32_t arming_periods(const SafetyConfig& safety, double period_s) noexcept;

class Arming {
 public:
  explicit Arming(const ControllerConfig& config) noexcept;

  void begin(const ValveVoltages& last) noexcept;
  void advance(std::int32_t elapsed_periods) noexcept { period_ += elapsed_periods; }

  bool law_acts() const noexcept { return period_ > ramp_periods_; }
  bool done() const noexcept { return period_ > ramp_periods_ + reduced_periods_; }
  // Periods that passed since done() became true, 0 in the first.
  std::int32_t periods_beyond() const noexcept {
    return period_ - ramp_periods_ - reduced_periods_ - 1;
  }
  // While the law does not act.
  ValveVoltages voltages() const noexcept;

 private:
  const ControllerConfig& config_;
  const std::int32_t ramp_periods_;
  const std::int32_t reduced_periods_;
  std::int32_t period_ = 0;  // 1 in the first cycle
  ValveVoltages start_;
};

}  // namespace eampc::control
