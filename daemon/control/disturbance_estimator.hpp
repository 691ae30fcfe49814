// Stage 3. In: the u that was on the valves, x (θ rad, θ̇ rad/s, v) and its innovation → out: σ̂ and
// what the law reads.
//   adaptive (13), (14), exact between samples:  σ̂ = −D⁻¹ e^{−aT} x̃,  x̃ = z − x
//                                                z⁺ = A* x + B* u + D σ̂ + e^{−aT} x̃
//   as printed, x held over the period:          σ̂ = −Φ(T) x̃,  z⁺ = x + e^{−aT} x̃ + (1 − e^{−aT})/a
//   · (A x + B u + σ̂) kalman:                                      d̂⁺ = d̂ + K_d (θ_measured − θ⁻),
//   σ̂1 = 0
// A constant δ leaves σ̂ at e^{−aT} δ (design 2.1 item 8): e^{aT} and the low-pass act on `for_law`
// only, the predictor keeps σ̂. Cost: a few 2×2 products. Absent: any bound on σ̂; the law's
// parameter box clamps what the law reads.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

class DisturbanceEstimator {
 public:
  explicit DisturbanceEstimator(const ControllerConfig& config) noexcept : config_(config) {}

  // One period passed with `u` on the valves: z⁺ from the x of the last update (adaptive only).
  void predict(double u) noexcept;

  DisturbanceEstimate update(const StateEstimate& state) noexcept;

  // δ̂ that the state's prediction uses, rad/s and rad/s².
  std::array<double, kMaxMeasured> for_prediction() const noexcept;

  // ACTIVE begins: what a Kalman d̂ learnt under another common-mode pressure is worth nothing now.
  // The adaptive estimate forgets within one period by itself.
  void law_begins() noexcept;

 private:
  // Where σ̂ settles under a constant δ = 1: e^{−aT}, or T Φ(T) with x held.
  double settled_share() const noexcept;
  MeasuredVector sigma_of_error() const noexcept;
  MeasuredVector error_of_sigma() const noexcept;

  const ControllerConfig& config_;
  StateVector x_ = StateVector::Zero();
  MeasuredVector z_ = MeasuredVector::Zero();
  MeasuredVector x_tilde_ = MeasuredVector::Zero();
  MeasuredVector sigma_ = MeasuredVector::Zero();
  MeasuredVector for_law_ = MeasuredVector::Zero();
};

}  // namespace eampc::control
