#include "control/voltage_guard.hpp"

#include <algorithm>
#include <cmath>

namespace eampc::control {

VoltageGuard::VoltageGuard(const ControllerConfig& config) noexcept
    : config_(config), last_{config.valve.safe_V, config.valve.safe_V, false} {}

ValveDemand VoltageGuard::safe(bool same_period) noexcept {
  if (!same_period || !last_.enable) period_start_ = last_;
  const ValveConfig& valve = config_.valve;
  return {
      {valve.safe_V, valve.safe_V, false}, {valve.min_V, valve.max_V}, {valve.min_V, valve.max_V}};
}

ValveDemand VoltageGuard::guard(const ValveVoltages& wanted, double slew_V_per_s, bool same_period,
                                std::uint32_t& limits) noexcept {
  if (!same_period || !last_.enable) period_start_ = last_;
  const double slew_V = slew_V_per_s * config_.model.period_s;
  ValveDemand demand;
  demand.voltages.enable = true;
  demand.voltages.u1_V =
      guard_one(wanted.u1_V, period_start_.u1_V, last_.u1_V, slew_V, demand.u1, limits);
  demand.voltages.u2_V =
      guard_one(wanted.u2_V, period_start_.u2_V, last_.u2_V, slew_V, demand.u2, limits);
  return demand;
}

double VoltageGuard::guard_one(double voltage_V, double start_V, double last_V, double slew_V,
                               VoltageWindow& window, std::uint32_t& limits) const noexcept {
  const ValveConfig& valve = config_.valve;
  // Not finite is unreachable after safety's own check; kept because these are the last lines.
  if (!std::isfinite(voltage_V)) voltage_V = last_V;
  if (voltage_V < valve.min_V || voltage_V > valve.max_V) {
    limits |= kLimitControlRange;
    voltage_V = std::clamp(voltage_V, valve.min_V, valve.max_V);
  }
  window = {std::max(valve.min_V, std::max(start_V, last_V) - slew_V),
            std::min(valve.max_V, std::min(start_V, last_V) + slew_V)};
  if (voltage_V < window.lower_V || voltage_V > window.upper_V) {
    limits |= kLimitSlewRate;
    voltage_V = std::clamp(voltage_V, window.lower_V, window.upper_V);
  }
  return voltage_V;
}

}  // namespace eampc::control
