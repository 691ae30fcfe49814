#include "control/disturbance_estimator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "control/reference_joint.hpp"

namespace eampc::control {
namespace {

// The linear model itself as plant, so that every expected number follows from (13) and (14) alone.
class LinearPlant {
 public:
  explicit LinearPlant(const DiscreteModel& model) : model_(model) {}

  StateEstimate measured(std::int32_t predicted_periods = 1, bool restarted = false) const {
    StateEstimate state;
    state.x = {x_[0], x_[1], x_[2]};
    state.measured = true;
    state.restarted = restarted;
    state.predicted_periods = predicted_periods;
    return state;
  }

  void advance(double u, double d) {
    x_ = StateVector(model_.A_star * x_ + model_.B_star * u + model_.D * MeasuredVector(0.0, d));
  }

  StateVector x_ = StateVector(0.1, -0.2, 1.0);

 private:
  const DiscreteModel& model_;
};

TEST(DisturbanceEstimator, AConstantLoadSettlesAtDecayTimesItAfterOnePeriod) {
  ReferenceJoint joint = reference_joint();
  joint.config.estimator.bias_compensation = false;
  LinearPlant plant(joint.config.model);
  DisturbanceEstimator estimator(joint.config);
  estimator.update(plant.measured(1, true));
  for (int k = 0; k < 5; ++k) {
    const double u = 3.0 * std::sin(k);
    estimator.predict(u);
    plant.advance(u, 30.0);
    const DisturbanceEstimate d = estimator.update(plant.measured());
    EXPECT_NEAR(d.sigma[0], 0.0, 1e-9);
    EXPECT_NEAR(d.sigma[1], std::exp(-0.025) * 30.0, 1e-9);
    EXPECT_NEAR(d.for_law[1], d.sigma[1], 1e-12);
  }
}

TEST(DisturbanceEstimator, BiasCompensationTouchesOnlyWhatTheLawReads) {
  const ReferenceJoint joint = reference_joint();
  LinearPlant plant(joint.config.model);
  DisturbanceEstimator estimator(joint.config);
  estimator.update(plant.measured(1, true));
  DisturbanceEstimate d;
  for (int k = 0; k < 50; ++k) {
    estimator.predict(1.0);
    plant.advance(1.0, -12.0);
    d = estimator.update(plant.measured());
  }
  EXPECT_NEAR(d.for_law[1], -12.0, 1e-9);
  EXPECT_NEAR(d.sigma[1], -12.0 * std::exp(-0.025), 1e-9);
}

TEST(DisturbanceEstimator, TheLowPassActsOnWhatTheLawReads) {
  ReferenceJoint joint = reference_joint();
  joint.config.estimator.low_pass_alpha = 0.25;
  LinearPlant plant(joint.config.model);
  DisturbanceEstimator estimator(joint.config);
  estimator.update(plant.measured(1, true));
  for (int k = 1; k <= 4; ++k) {
    estimator.predict(0.0);
    plant.advance(0.0, 8.0);
    const DisturbanceEstimate d = estimator.update(plant.measured());
    EXPECT_NEAR(d.for_law[1], 8.0 * (1.0 - std::pow(0.75, k)), 1e-9);
    EXPECT_NEAR(d.sigma[1], 8.0 * std::exp(-0.025), 1e-9);
  }
}

// For ẋ = δ (A = B = 0): x̃⁺ = e^{−aT} x̃ + κ σ̂ − T δ = −T δ, so σ̂ = Φ T δ with Φ = a/(e^{aT} − 1).
TEST(DisturbanceEstimator, AsPrintedSettlesAtPhiTimesT) {
  ReferenceJoint joint = reference_joint(false);
  joint.config.model.A.setZero();
  joint.config.model.B.setZero();
  set_sampled_model(joint.config.model);
  joint.config.estimator.as_printed = true;
  LinearPlant plant(joint.config.model);
  DisturbanceEstimator estimator(joint.config);
  estimator.update(plant.measured(1, true));
  for (int k = 0; k < 3; ++k) {
    estimator.predict(0.0);
    plant.advance(0.0, 4.0);
    const DisturbanceEstimate d = estimator.update(plant.measured());
    EXPECT_NEAR(d.sigma[1], 4.0 * 0.025 / (std::exp(0.025) - 1.0), 1e-10);
    EXPECT_NEAR(d.for_law[1], 4.0, 1e-10);
  }
}

// One step by hand, a = 5, T = 5 ms, b1 = −100, b2 = 0, b = 2, x = (1, 0), u = 3, x̃ = 0, σ̂ = 0:
// z⁺ = x + κ (A x + B u), κ = (1 − e^{−0.025})/5; z2⁺ = κ (−100 + 6). With x⁺ = (1, 0): σ̂ = −Φ (z⁺
// − x⁺).
TEST(DisturbanceEstimator, AsPrintedOneStepByHand) {
  ReferenceJoint joint = reference_joint(false);
  DiscreteModel& m = joint.config.model;
  m.A(1, 0) = -100.0;
  m.A(1, 1) = 0.0;
  m.B(1) = 2.0;
  joint.config.estimator.as_printed = true;
  DisturbanceEstimator estimator(joint.config);
  StateEstimate x;
  x.x = {1.0, 0.0, 0.0};
  x.measured = true;
  x.restarted = true;
  estimator.update(x);
  estimator.predict(3.0);
  x.restarted = false;
  const DisturbanceEstimate d = estimator.update(x);
  const double kappa = (1.0 - std::exp(-0.025)) / 5.0;
  const double phi = 5.0 / (std::exp(0.025) - 1.0);
  EXPECT_NEAR(d.sigma[0], 0.0, 1e-12);
  EXPECT_NEAR(d.sigma[1], phi * kappa * 94.0, 1e-9);
}

TEST(DisturbanceEstimator, WithoutASampleTheEstimateIsHeld) {
  const ReferenceJoint joint = reference_joint();
  LinearPlant plant(joint.config.model);
  DisturbanceEstimator estimator(joint.config);
  estimator.update(plant.measured(1, true));
  estimator.predict(0.0);
  plant.advance(0.0, 5.0);
  const DisturbanceEstimate before = estimator.update(plant.measured());
  estimator.predict(0.0);
  StateEstimate missing;
  missing.predicted_periods = 2;
  const DisturbanceEstimate held = estimator.update(missing);
  EXPECT_EQ(held.sigma, before.sigma);
  EXPECT_EQ(held.for_law, before.for_law);
}

// A load step inside a gap of three periods: the first sample after it must see the new load, not
// thrice the change.
TEST(DisturbanceEstimator, TheFirstSampleAfterAGapScalesTheInnovation) {
  const ReferenceJoint joint = reference_joint();
  const DiscreteModel& model = joint.config.model;
  LinearPlant plant(model);
  DisturbanceEstimator estimator(joint.config);
  estimator.update(plant.measured(1, true));
  for (int k = 0; k < 3; ++k) {
    estimator.predict(0.0);
    plant.advance(0.0, 5.0);
    estimator.update(plant.measured());
  }
  StateVector predicted = plant.x_;
  for (int k = 0; k < 4; ++k) {
    plant.advance(0.0, 25.0);
    predicted = StateVector(model.A_star * predicted + model.D * MeasuredVector(0.0, 5.0));
    estimator.predict(0.0);
    if (k < 3) {
      StateEstimate missing;
      missing.predicted_periods = k + 1;
      estimator.update(missing);
    }
  }
  StateEstimate x = plant.measured(4);
  x.innovation_rad = plant.x_[0] - predicted[0];
  x.innovation_rad_s = plant.x_[1] - predicted[1];
  EXPECT_NEAR(estimator.update(x).for_law[1], 25.0, 2.0);
  estimator.predict(0.0);
  plant.advance(0.0, 25.0);
  EXPECT_NEAR(estimator.update(plant.measured()).for_law[1], 25.0, 1e-9);
}

TEST(DisturbanceEstimator, KalmanAddsGainTimesInnovationAndForgetsAtActiveEntry) {
  ReferenceJoint joint = reference_joint();
  joint.config.estimator.kind = EstimatorKind::kKalman;
  joint.config.estimator.kalman_disturbance_gain = 1000.0;
  joint.config.estimator.low_pass_alpha = 0.5;
  DisturbanceEstimator estimator(joint.config);
  StateEstimate x;
  x.measured = true;
  x.innovation_rad = 0.002;
  DisturbanceEstimate d = estimator.update(x);
  EXPECT_EQ(d.sigma[0], 0.0);
  EXPECT_NEAR(d.sigma[1], 2.0, 1e-12);
  EXPECT_NEAR(d.for_law[1], 1.0, 1e-12);
  EXPECT_NEAR(estimator.for_prediction()[1], 2.0,
              1e-12);  // the filter's own d̂, not the low-passed one
  estimator.law_begins();
  EXPECT_EQ(estimator.for_prediction()[1], 0.0);
}

}  // namespace
}  // namespace eampc::control
