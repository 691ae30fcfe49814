// Stage 2. In: sample (rad, rad/s), the u that was on the valves, δ̂ (rad/s, rad/s²) → out: x = (θ
// rad, θ̇ rad/s, v).
//   x⁻ = A* x + B* u + D δ̂   each period
//   adaptive: θ and θ̇ are the measured ones;   kalman: (θ, θ̇) = (θ⁻, θ̇⁻) + K (θ_measured − θ⁻)
// v has no sensor: it is propagated from the u sent, in every mode. Without a sample x⁻ stands.
// Cost: one 3×3 product per period. Absent: any difference over arrival times; a time-varying gain.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

class StateEstimator {
 public:
  explicit StateEstimator(const ControllerConfig& config) noexcept;

  // One period passed with `u` on the valves and δ̂ = (rad/s on θ, rad/s² on θ̇).
  void predict(double u, const std::array<double, kMaxMeasured>& disturbance) noexcept;

  // The sample of this period onto the prediction.
  StateEstimate correct(const EncoderSample& sample) noexcept;

 private:
  const ControllerConfig& config_;
  // After a silence this long nobody may act on the estimate; an unstable model must not run off
  // meanwhile.
  std::int32_t longest_prediction_periods_;
  StateVector x_ = StateVector::Zero();
  bool started_ = false;
  std::int32_t periods_since_sample_ = 0;
};

}  // namespace eampc::control
