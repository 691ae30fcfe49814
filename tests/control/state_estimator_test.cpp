#include "control/state_estimator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "control/reference_joint.hpp"

namespace eampc::control {
namespace {

EncoderSample sample(double angle_rad, double velocity_rad_s = 0.0, bool has_velocity = true) {
  EncoderSample s;
  s.verdict = SampleVerdict::kValid;
  s.angle_rad = angle_rad;
  s.velocity_rad_s = velocity_rad_s;
  s.has_velocity = has_velocity;
  return s;
}

TEST(StateEstimator, AdaptiveReadsWhatIsMeasuredAndPropagatesTheValve) {
  const ReferenceJoint joint = reference_joint();
  StateEstimator estimator(joint.config);
  estimator.predict(0.0, {0.0, 0.0});
  StateEstimate x = estimator.correct(sample(0.1, 0.2));
  EXPECT_TRUE(x.restarted);
  EXPECT_EQ(x.innovation_rad, 0.0);
  EXPECT_EQ(x.x[0], 0.1);
  EXPECT_EQ(x.x[1], 0.2);
  estimator.predict(10.0, {0.0, 0.0});
  x = estimator.correct(sample(0.1, 0.2));
  EXPECT_FALSE(x.restarted);
  EXPECT_EQ(x.predicted_periods, 1);
  // First-order lag: 10 (1 − e^{−T/τ}), T/τ = 5/30.
  EXPECT_NEAR(x.x[2], 10.0 * (1.0 - std::exp(-5.0 / 30.0)), 1e-12);
}

// Free fall under δ2: with b1 = b2 = 0 the model is a double integrator and one period is ½ δ T².
TEST(StateEstimator, PredictsWithTheModelWhenAFrameIsMissing) {
  ReferenceJoint joint = reference_joint(false);
  joint.config.model.A.setZero();
  joint.config.model.A(0, 1) = 1.0;
  joint.config.model.B.setZero();
  set_sampled_model(joint.config.model);
  StateEstimator estimator(joint.config);
  estimator.correct(sample(1.0, 2.0));
  for (int period = 1; period <= 3; ++period) {
    estimator.predict(0.0, {0.0, 8.0});
    const StateEstimate x = estimator.correct({});
    const double t = 0.005 * period;
    EXPECT_FALSE(x.measured);
    EXPECT_EQ(x.predicted_periods, period);
    EXPECT_NEAR(x.x[0], 1.0 + 2.0 * t + 4.0 * t * t, 1e-12);
    EXPECT_NEAR(x.x[1], 2.0 + 8.0 * t, 1e-12);
  }
}

TEST(StateEstimator, ALongSilenceHoldsTheAngleAndStartsAnew) {
  ReferenceJoint joint = reference_joint(false);
  joint.config.model.A(1, 0) = 900.0;  // open-loop unstable, as case 1 of the paper
  set_sampled_model(joint.config.model);
  StateEstimator estimator(joint.config);
  estimator.correct(sample(0.5, 1.0));
  StateEstimate x;
  for (int period = 0; period < 100'000; ++period) {
    estimator.predict(0.0, {0.0, 0.0});
    x = estimator.correct({});
  }
  EXPECT_LT(std::abs(x.x[0]), 2.0);
  estimator.predict(0.0, {0.0, 0.0});
  x = estimator.correct(sample(-0.5, 0.0));
  EXPECT_TRUE(x.restarted);
  EXPECT_EQ(x.x[0], -0.5);
}

TEST(StateEstimator, ASilenceWithinTheTimeOutIsNotANewStart) {
  const ReferenceJoint joint = reference_joint();
  StateEstimator estimator(joint.config);
  estimator.correct(sample(0.5));
  for (int period = 0; period < 4; ++period) {  // 20 ms time-out, 5 ms periods
    estimator.predict(0.0, {0.0, 0.0});
    estimator.correct({});
  }
  estimator.predict(0.0, {0.0, 0.0});
  EXPECT_FALSE(estimator.correct(sample(0.5)).restarted);
}

// v is propagated from cycle to cycle: what is not finite would stay for ever.
TEST(StateEstimator, RecoversFromANumberThatIsNotFinite) {
  for (const EstimatorKind kind : {EstimatorKind::kAdaptive, EstimatorKind::kKalman}) {
    ReferenceJoint joint = reference_joint();
    joint.config.estimator.kind = kind;
    StateEstimator estimator(joint.config);
    const EncoderSample sample{SampleVerdict::kValid, 0.1, 0.2, true, 0, 0};
    estimator.predict(0.0, {});
    estimator.correct(sample);
    estimator.predict(std::numeric_limits<double>::infinity(), {});
    EXPECT_FALSE(std::isfinite(estimator.correct(sample).x[2]));  // safety stops on it
    estimator.predict(1.0, {});
    const StateEstimate recovered = estimator.correct(sample);
    EXPECT_TRUE(recovered.restarted);
    EXPECT_EQ(recovered.x[0], 0.1);
    EXPECT_EQ(recovered.x[1], 0.2);
    EXPECT_NEAR(recovered.x[2], joint.config.model.B_star(2), 1e-15);
  }
}

TEST(StateEstimator, KalmanCorrectsByGainTimesInnovation) {
  ReferenceJoint joint = reference_joint();
  joint.config.estimator.kind = EstimatorKind::kKalman;
  joint.config.estimator.kalman_state_gain = {0.5, 20.0};
  StateEstimator estimator(joint.config);
  StateEstimate x = estimator.correct(sample(0.2, 99.0, false));
  EXPECT_EQ(x.x[0], 0.2);
  EXPECT_EQ(x.x[1], 0.0);
  const double predicted = joint.config.model.A_star(0, 0) * 0.2 + joint.config.model.D(0, 1) * 3.0;
  const double predicted_rate =
      joint.config.model.A_star(1, 0) * 0.2 + joint.config.model.D(1, 1) * 3.0;
  estimator.predict(0.0, {0.0, 3.0});
  x = estimator.correct(sample(0.21, 0.0, false));
  EXPECT_NEAR(x.innovation_rad, 0.21 - predicted, 1e-15);
  EXPECT_NEAR(x.x[0], predicted + 0.5 * (0.21 - predicted), 1e-15);
  EXPECT_NEAR(x.x[1], predicted_rate + 20.0 * (0.21 - predicted), 1e-13);
}

}  // namespace
}  // namespace eampc::control
