#include "control/arming.hpp"

#include "control/period_count.hpp"
#include "control/voltage_ramp.hpp"

namespace eampc::control {

std::int32_t arming_periods(const SafetyConfig& safety, double period_s) noexcept {
  return periods_in(safety.arming_ramp_s, period_s) + periods_in(safety.reduced_limits_s, period_s);
}

Arming::Arming(const ControllerConfig& config) noexcept
    : config_(config),
      ramp_periods_(periods_in(config.safety.arming_ramp_s, config.model.period_s)),
      reduced_periods_(periods_in(config.safety.reduced_limits_s, config.model.period_s)) {}

void Arming::begin(const ValveVoltages& last) noexcept {
  start_ = last;
  period_ = 1;
}

ValveVoltages Arming::voltages() const noexcept {
  return on_ramp(start_, config_.valve.bias_V, period_, ramp_periods_);
}

}  // namespace eampc::control
