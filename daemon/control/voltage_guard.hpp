// The last lines before the wire. In: wanted voltages (V) → out: the same, finite, inside
// valve.min_V..max_V and within one slew step of the command before, with the windows that the
// codec may round in. Cost: constant. Absent: any reason to want a voltage.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

class VoltageGuard {
 public:
  explicit VoltageGuard(const ControllerConfig& config) noexcept;

  // A second command in one period (`same_period`) must not double the rate: it stays within one
  // step of the period's beginning as well as of the command before it. From a disabled node there
  // is no step. Adds to `limits` what it had to clamp.
  ValveDemand guard(const ValveVoltages& wanted, double slew_V_per_s, bool same_period,
                    std::uint32_t& limits) noexcept;
  // valve.safe_V and enable bit 0 at once, whatever the slew limit.
  ValveDemand safe(bool same_period) noexcept;

  // The voltages as they stand in the frame: where ramps and the slew limit go on from.
  void sent(const ValveVoltages& voltages) noexcept { last_ = voltages; }
  const ValveVoltages& last() const noexcept { return last_; }

 private:
  double guard_one(double voltage_V, double start_V, double last_V, double slew_V,
                   VoltageWindow& window, std::uint32_t& limits) const noexcept;

  const ControllerConfig& config_;
  ValveVoltages last_;
  ValveVoltages period_start_;  // last_ when the present period began
};

}  // namespace eampc::control
