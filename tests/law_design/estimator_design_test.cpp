#include "law_design/estimator_design.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "law_design/discretisation.hpp"
#include "law_design/joint_model.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

TEST(EstimatorDesign, NumbersByHand) {
  EXPECT_NEAR(estimator_decay(10.0, 0.005), 0.951229424500714, 1e-15);  // e^{−0.05}
  EXPECT_NEAR(low_pass_alpha(8.0, 0.005), 0.22223232, 1e-8);            // 1 − e^{−0.08π}
  EXPECT_EQ(low_pass_alpha(0.0, 0.005), 1.0);
}

// Correction 2.1 item 8: with a constant δ the estimate of (13), (14) settles at e^{−aT} δ in one
// period, so the compensated one is exact.
TEST(EstimatorDesign, ConstantDisturbanceIsFoundUpToTheDecay) {
  for (const double bias_V : {2.0, 0.0}) {
    const ContinuousModel continuous = joint_model(paper_rig(bias_V));
    const SampledModel model = discretise(continuous.A, continuous.B, 0.005);
    const double decay = estimator_decay(10.0, 0.005);
    const Eigen::Matrix2d D_inverse = disturbance_inverse(model);
    const Eigen::Vector2d delta(0.0, 0.8);
    Eigen::Vector2d x(0.1, -1.0), z = x, sigma = Eigen::Vector2d::Zero();
    for (int k = 0; k < 4; ++k) {
      const double u = 5.0 - k;
      z = model.A_star * x + model.B_star * u + model.D * sigma + decay * (z - x);
      x = model.A_star * x + model.B_star * u + model.D * delta;
      sigma = -decay * D_inverse * (z - x);
      EXPECT_NEAR(sigma(1), decay * delta(1), 1e-10);
      EXPECT_NEAR(sigma(0), 0.0, 1e-10);
    }
  }
}

// Oracle: the Riccati recursion itself, run until it stands still.
TEST(EstimatorDesign, KalmanGainsAreTheFixedPointOfTheRecursion) {
  const ContinuousModel continuous = joint_model(reference_rig());
  const KalmanNoise noise{.angle_noise_rad = 1.4e-5,
                          .disturbance_walk_rad_s2_sqrt_Hz = 50.0,
                          .velocity_walk_rad_s_sqrt_Hz = 0.01};
  const double T = 0.005;
  const KalmanGains gains = kalman_gains(continuous.joint_A(), noise, T);

  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  A.topLeftCorner<2, 2>() = continuous.joint_A();
  A(1, 2) = 1.0;
  // F and the noise of one period by 1000 small Euler steps with midpoint transition.
  constexpr int kSteps = 1000;
  const double h = T / kSteps;
  const Eigen::Matrix3d small = Eigen::Matrix3d::Identity() + h * A + 0.5 * h * h * A * A;
  Eigen::Matrix3d F = Eigen::Matrix3d::Identity(), Q = Eigen::Matrix3d::Zero(), W = Q;
  W(1, 1) = 0.01 * 0.01;
  W(2, 2) = 50.0 * 50.0;
  for (int i = 0; i < kSteps; ++i) {
    Q = small * (Q + 0.5 * h * W) * small.transpose() + 0.5 * h * W;
    F = small * F;
  }
  const double r = noise.angle_noise_rad * noise.angle_noise_rad;
  Eigen::Matrix3d P = Q;
  Eigen::Vector3d K = Eigen::Vector3d::Zero();
  for (int i = 0; i < 5000; ++i) {
    K = P.col(0) / (P(0, 0) + r);
    const Eigen::Matrix3d corrected = P - K * P.row(0);
    P = F * corrected * F.transpose() + Q;
  }
  EXPECT_NEAR(gains.state(0), K(0), 1e-5);
  EXPECT_NEAR(gains.state(1) / K(1), 1.0, 1e-5);
  EXPECT_NEAR(gains.disturbance / K(2), 1.0, 1e-5);
}

}  // namespace
}  // namespace eampc::law_design
