#include "control/disturbance_estimator.hpp"

namespace eampc::control {

double DisturbanceEstimator::settled_share() const noexcept {
  const EstimatorConfig& e = config_.estimator;
  return e.as_printed ? e.decay / e.held_integral_s * config_.model.period_s : e.decay;
}

MeasuredVector DisturbanceEstimator::sigma_of_error() const noexcept {
  const EstimatorConfig& e = config_.estimator;
  if (e.as_printed) {
    return -(e.decay / e.held_integral_s) * x_tilde_;
  }
  return -e.decay * (e.D_inverse * x_tilde_);
}

MeasuredVector DisturbanceEstimator::error_of_sigma() const noexcept {
  const EstimatorConfig& e = config_.estimator;
  if (e.as_printed) {
    return -(e.held_integral_s / e.decay) * sigma_;
  }
  return -(config_.model.D.topRows<kMaxMeasured>() * sigma_) / e.decay;
}

void DisturbanceEstimator::predict(double u) noexcept {
  const EstimatorConfig& e = config_.estimator;
  if (e.kind != EstimatorKind::kAdaptive) {
    return;
  }
  const DiscreteModel& model = config_.model;
  if (e.as_printed) {
    const StateVector rate = model.A * x_ + model.B * u;
    z_ = x_.head<kMaxMeasured>() + e.decay * x_tilde_ +
         e.held_integral_s * (rate.head<kMaxMeasured>() + sigma_);
    return;
  }
  const StateVector nominal = model.A_star * x_ + model.B_star * u;
  z_ = nominal.head<kMaxMeasured>() + model.D.topRows<kMaxMeasured>() * sigma_ + e.decay * x_tilde_;
}

DisturbanceEstimate DisturbanceEstimator::update(const StateEstimate& state) noexcept {
  const EstimatorConfig& e = config_.estimator;
  const bool adaptive = e.kind == EstimatorKind::kAdaptive;
  if (state.measured) {
    const MeasuredVector innovation(state.innovation_rad, state.innovation_rad_s);
    if (state.restarted) {
      sigma_.setZero();
      for_law_.setZero();
      x_tilde_.setZero();
    } else if (!adaptive) {
      sigma_[1] += e.kalman_disturbance_gain * state.innovation_rad;
    } else if (state.predicted_periods <= 1) {
      x_tilde_ = z_ - MeasuredVector(state.x[0], state.x[1]);
      sigma_ = sigma_of_error();
    } else {
      // First sample after a gap: the prediction ran over several periods with the old δ̂, so its
      // error is about that many times D (δ − δ̂).
      sigma_ = e.decay *
               (for_law_ + e.D_inverse * innovation / static_cast<double>(state.predicted_periods));
      x_tilde_ = error_of_sigma();
    }
    const bool compensate = adaptive && e.bias_compensation;
    for_law_ += e.low_pass_alpha * ((compensate ? 1.0 / settled_share() : 1.0) * sigma_ - for_law_);
  }
  x_ = StateVector(state.x[0], state.x[1], state.x[2]);
  return {{sigma_[0], sigma_[1]}, {for_law_[0], for_law_[1]}};
}

std::array<double, kMaxMeasured> DisturbanceEstimator::for_prediction() const noexcept {
  // A steady-state Kalman filter predicts with its own d̂, before the law's low-pass.
  const MeasuredVector& delta =
      config_.estimator.kind == EstimatorKind::kKalman ? sigma_ : for_law_;
  return {delta[0], delta[1]};
}

void DisturbanceEstimator::law_begins() noexcept {
  if (config_.estimator.kind == EstimatorKind::kKalman) {
    sigma_.setZero();
    for_law_.setZero();
  }
}

}  // namespace eampc::control
