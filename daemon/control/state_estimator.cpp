#include "control/state_estimator.hpp"

#include <algorithm>
#include <cmath>

namespace eampc::control {

StateEstimator::StateEstimator(const ControllerConfig& config) noexcept
    : config_(config),
      longest_prediction_periods_(static_cast<std::int32_t>(
          std::max(1.0, std::round(config.safety.encoder_timeout_s / config.model.period_s)))) {}

void StateEstimator::predict(double u,
                             const std::array<double, kMaxMeasured>& disturbance) noexcept {
  const DiscreteModel& model = config_.model;
  const MeasuredVector delta(disturbance[0], disturbance[1]);
  StateVector next = model.A_star * x_ + model.B_star * u + model.D * delta;
  if (periods_since_sample_ <= longest_prediction_periods_) {
    ++periods_since_sample_;
  } else {
    started_ = false;
  }
  if (!started_) {
    next[0] = x_[0];
    next[1] = x_[1];
  }
  x_ = next;
}

StateEstimate StateEstimator::correct(const EncoderSample& sample) noexcept {
  StateEstimate estimate;
  estimate.predicted_periods = periods_since_sample_;
  if (sample.verdict == SampleVerdict::kValid) {
    estimate.measured = true;
    estimate.restarted = !started_;
    if (started_) {
      estimate.innovation_rad = sample.angle_rad - x_[0];
      estimate.innovation_rad_s = sample.has_velocity ? sample.velocity_rad_s - x_[1] : 0.0;
    }
    if (!started_ || config_.estimator.kind == EstimatorKind::kAdaptive) {
      x_[0] = sample.angle_rad;
      x_[1] = sample.has_velocity ? sample.velocity_rad_s : 0.0;
    } else {
      x_[0] += config_.estimator.kalman_state_gain[0] * estimate.innovation_rad;
      x_[1] += config_.estimator.kalman_state_gain[1] * estimate.innovation_rad;
    }
    started_ = true;
    periods_since_sample_ = 0;
  }
  for (int i = 0; i < kMaxStates; ++i) {
    estimate.x[static_cast<std::size_t>(i)] = x_[i];
  }
  if (!x_.allFinite()) {
    // Told once, for safety to stop on; kept, it would stay in v and in a Kalman estimate for ever.
    x_.setZero();
    started_ = false;
  }
  return estimate;
}

}  // namespace eampc::control
