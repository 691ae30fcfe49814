// Stage 4. In: x (rad, rad/s, v), δ̂ (rad/s, rad/s²), reference (rad, rad/s, rad/s²) → out: u and
// the piece that gave it.
//   paper:    p = (x1, x2, σ̂1, σ̂2 [, y_r])
//   tracking: p = (θ − y_r, θ̇ − ẏ_r [, v − u_ss], u_ss, y_r, ẏ_r),  u_ss = (ÿ_r − b1 y_r − b2 ẏ_r −
//   d̂)/b
// A parameter outside the box is clamped onto it and reported; u_ss is clamped before v − u_ss is
// formed. Cost: that of one evaluation of the law (service::evaluation_cost) and np comparisons.
// Absent: any online optimisation.
#pragma once

#include <array>

#include "control/controller_config.hpp"

namespace eampc::control {

using ParameterVector = std::array<double, kMaxParameters>;

class ExplicitLaw {
 public:
  explicit ExplicitLaw(const ControllerConfig& config) noexcept : config_(config) {}

  LawOutput decide(const StateEstimate& state, const DisturbanceEstimate& disturbance,
                   const Reference& reference) const noexcept;

  // The law at a given p: clamp onto the box, find the piece, clip u.
  LawOutput at(ParameterVector p) const noexcept;

 private:
  const ControllerConfig& config_;
};

}  // namespace eampc::control
