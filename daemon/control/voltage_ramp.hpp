// Both valve voltages on a straight line over whole periods.
#pragma once

#include <cstdint>

#include "control/control_types.hpp"

namespace eampc::control {

// `done` of `of` periods on the way from `start` to `target_V` on both; at the end exactly there.
inline ValveVoltages on_ramp(const ValveVoltages& start, double target_V, std::int32_t done,
                             std::int32_t of) noexcept {
  if (done >= of) return {target_V, target_V, true};
  const double share = static_cast<double>(done) / static_cast<double>(of);
  return {start.u1_V + (target_V - start.u1_V) * share,
          start.u2_V + (target_V - start.u2_V) * share, true};
}

}  // namespace eampc::control
