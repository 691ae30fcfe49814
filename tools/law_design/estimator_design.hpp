// Numbers the estimators run with: exponentials, inverses and gains, worked out before real time.
#pragma once

#include <Eigen/Dense>

#include "law_design/discretisation.hpp"

namespace eampc::law_design {

/// e^{−aT} of (13), (14).
double estimator_decay(double adaptation_rate_per_s, double period_s);

/// D⁻¹ on the measured coordinates (θ, θ̇): σ̂ = −D⁻¹ e^{−aT} (z − x).
Eigen::Matrix2d disturbance_inverse(const SampledModel& model);

/// α = 1 − e^{−2π f T} of d̂ ← d̂ + α (new − d̂); frequency 0 switches the filter off (α = 1).
double low_pass_alpha(double frequency_hz, double period_s);

/// Noise model of the position-only estimator on (θ, θ̇, d).
struct KalmanNoise {
  double angle_noise_rad = 0.0;  // standard deviation of one measurement
  // Densities of the white noise that drives d and θ̇ (one standard deviation after one second).
  double disturbance_walk_rad_s2_sqrt_Hz = 0.0;
  double velocity_walk_rad_s_sqrt_Hz = 0.0;
};

struct KalmanGains {
  Eigen::Vector2d state = Eigen::Vector2d::Zero();  // rad per rad, rad/s per rad
  double disturbance = 0.0;                         // rad/s² per rad
};

/// Steady-state gains of the measurement update, x̂ = x̂⁻ + K (θ_measured − θ⁻).
KalmanGains kalman_gains(const Eigen::Matrix2d& joint_A, const KalmanNoise& noise, double period_s);

}  // namespace eampc::law_design
