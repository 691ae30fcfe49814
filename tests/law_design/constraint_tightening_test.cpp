#include "law_design/constraint_tightening.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "law_design/design_error.hpp"
#include "law_design/joint_model.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

Eigen::Matrix2d double_integrator() {
  Eigen::Matrix2d A;
  A << 0.0, 1.0, 0.0, 0.0;
  return A;
}

// e^{At} has the second column (t, 1): with φ = ḋ (s + age),
// ε2 = ḋ (t²/2 + age t), ε1 = ḋ (t³/6 + age t²/2).
TEST(ComponentwiseTightening, DoubleIntegratorByHand) {
  const Eigen::MatrixXd epsilon = componentwise_tightening(
      double_integrator(), {.max_rad_s2 = 1e6, .rate_max_rad_s3 = 6.0}, {.age_s = 0.1}, 0.1, 5);
  ASSERT_EQ(epsilon.rows(), 6);
  EXPECT_EQ(epsilon.row(0).norm(), 0.0);
  EXPECT_NEAR(epsilon(5, 1), 6.0 * (0.125 + 0.05), 1e-12);
  EXPECT_NEAR(epsilon(5, 0), 0.125 + 6.0 * 0.1 * 0.125, 1e-12);
}

TEST(ComponentwiseTightening, TwoDisturbancesDifferByTwiceTheBoundAtMost) {
  const Eigen::MatrixXd epsilon = componentwise_tightening(
      double_integrator(), {.max_rad_s2 = 3.0, .rate_max_rad_s3 = 1e9}, {.age_s = 0.1}, 0.1, 4);
  EXPECT_NEAR(epsilon(4, 1), 6.0 * 0.4, 1e-12);
  EXPECT_NEAR(epsilon(4, 0), 6.0 * 0.08, 1e-12);
}

TEST(ComponentwiseTightening, BiasOfThePrintedEstimatorCounts) {
  const DisturbanceBounds bounds{.max_rad_s2 = 3.0, .rate_max_rad_s3 = 0.0};
  const Eigen::MatrixXd epsilon = componentwise_tightening(
      double_integrator(), bounds, {.age_s = 0.1, .relative_bias = 0.05}, 0.1, 4);
  EXPECT_NEAR(epsilon(4, 1), 0.05 * 3.0 * 0.4, 1e-12);
}

// Oracle: disturbances inside the bounds, true and predicted state integrated side by side.
TEST(ComponentwiseTightening, NoDisturbanceWithinTheBoundsLeavesTheTube) {
  const ContinuousModel model = joint_model(reference_rig());
  const double T = 0.005, d_max = 60.0, rate = 200.0;
  const int horizon = 30, substeps = 50;
  const Eigen::MatrixXd epsilon = componentwise_tightening(
      model.joint_A(), {.max_rad_s2 = d_max, .rate_max_rad_s3 = rate}, {.age_s = T}, T, horizon);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  double closest = 0.0;
  for (int run = 0; run < 200; ++run) {
    // The estimate is the disturbance one period ago; then it moves at up to the full rate.
    double d = d_max * uniform(random);
    const double estimate = d;
    double slope = rate * (run % 2 == 0 ? (uniform(random) > 0.0 ? 1.0 : -1.0) : uniform(random));
    const double h = T / substeps;
    d = std::clamp(d + slope * T, -d_max, d_max);
    Eigen::Vector2d error = Eigen::Vector2d::Zero();
    for (int i = 1; i <= horizon; ++i) {
      for (int k = 0; k < substeps; ++k) {
        const Eigen::Vector2d push(0.0, d - estimate);
        const Eigen::Vector2d k1 = model.joint_A() * error + push;
        const Eigen::Vector2d k2 = model.joint_A() * (error + 0.5 * h * k1) + push;
        error += h * k2;
        d = std::clamp(d + slope * h, -d_max, d_max);
      }
      if (run % 4 == 1) slope = rate * uniform(random);
      for (int j = 0; j < 2; ++j) {
        ASSERT_LE(std::abs(error(j)), epsilon(i, j) * (1.0 + 1e-3)) << "stage " << i;
        closest = std::max(closest, std::abs(error(j)) / epsilon(i, j));
      }
    }
  }
  EXPECT_GT(closest, 0.95);  // a ramp at full rate comes close: the bound is not loose
}

// By hand: ‖A‖ = ‖B‖ = 1, ‖x‖ ≤ 5, β = 8, ‖Ax + Bu‖ ≤ √20, ρ = 3.5 + 0.7 (√20 + 8) = 12.230495,
// γ = 0.002 ρ + 8 (1 − e^{−0.01}) = 0.1040623, ℰ = 5,
// φ = 7.5 (e^{0.02} − 1) + 0.02 + γ = 0.2755724, ε^10 = φ (e^{0.01} − 1) = 0.00276955.
TEST(TheoremTightening, ByHand) {
  const StateBounds bounds{.angle_max_rad = 3.0, .velocity_max_rad_s = 4.0, .control_max = 2.0};
  const LipschitzConstants constants{.l_delta = 1.0,
                                     .l_t = 2.0,
                                     .b_delta = 3.0,
                                     .l_delta_t = 0.5,
                                     .b_delta_t = 1.0,
                                     .l_delta_x = 0.1,
                                     .b_delta_x = 0.2};
  const Eigen::MatrixXd epsilon = theorem_tightening(double_integrator(), Eigen::Vector2d(0.0, 1.0),
                                                     bounds, constants, 10.0, 0.001, 10);
  EXPECT_NEAR(epsilon(10, 0), 0.00276955, 1e-8);
  EXPECT_EQ(epsilon(10, 0), epsilon(10, 1));
  EXPECT_EQ(epsilon(0, 0), 0.0);
}

TEST(TheoremTightening, IsUsableOnThePaperAndUselessOnTheReferenceRig) {
  const ContinuousModel case1 = joint_model(paper_rig(2.0));
  const StateBounds bounds{.angle_max_rad = 2.0, .velocity_max_rad_s = 5.0, .control_max = 60.0};
  const double gradient = std::sqrt(2.0);  // of sin(x1 + x2)
  const LipschitzConstants constants{.l_delta = gradient, .b_delta_x = gradient};
  const Eigen::MatrixXd small =
      theorem_tightening(case1.joint_A(), case1.joint_B(), bounds, constants, 10.0, 0.001, 10);
  EXPECT_GT(small(1, 0), 0.003);
  EXPECT_LT(small(10, 0), 0.065);
  EXPECT_NO_THROW(require_room(small, bounds, "theorem"));

  const ContinuousModel reference = joint_model(reference_rig());
  const StateBounds narrow{.angle_max_rad = 1.0, .velocity_max_rad_s = 6.0, .control_max = 11.1};
  const Eigen::MatrixXd large =
      theorem_tightening(reference.joint_A(), reference.joint_B(), narrow,
                         {.l_delta = 30.0, .b_delta_x = 30.0}, 5.0, 0.005, 30);
  EXPECT_GT(large(30, 0), 1e10);
}

TEST(RequireRoom, NamesStageBoundAndWhatToChange) {
  const StateBounds bounds{.angle_max_rad = 1.0, .velocity_max_rad_s = 6.0, .control_max = 1.0};
  Eigen::MatrixXd epsilon = Eigen::MatrixXd::Constant(5, 2, 0.5);
  EXPECT_NO_THROW(require_room(epsilon, bounds, "componentwise"));
  epsilon(3, 1) = 6.0;
  try {
    require_room(epsilon, bounds, "componentwise");
    FAIL() << "an empty set was accepted";
  } catch (const DesignError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("stage 3"), std::string::npos) << text;
    EXPECT_NE(text.find("constraints.velocity_max_rad_s = 6 rad/s"), std::string::npos) << text;
    EXPECT_NE(text.find("tightening.disturbance_max_rad_s2"), std::string::npos) << text;
    EXPECT_NE(text.find("control.horizon"), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace eampc::law_design
