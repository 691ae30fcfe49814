#include "law_design/discretisation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "law_design/joint_model.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

// Oracle: ẋ = A x + B u + δ integrated over one period by 20,000 Runge-Kutta steps.
Eigen::VectorXd integrated(const ContinuousModel& model, Eigen::VectorXd x, double u,
                           const Eigen::Vector2d& delta, double period_s) {
  constexpr int kSteps = 20000;
  const double h = period_s / kSteps;
  Eigen::VectorXd constant = model.B * u;
  constant.head<2>() += delta;
  for (int i = 0; i < kSteps; ++i) {
    const Eigen::VectorXd k1 = model.A * x + constant;
    const Eigen::VectorXd k2 = model.A * (x + 0.5 * h * k1) + constant;
    const Eigen::VectorXd k3 = model.A * (x + 0.5 * h * k2) + constant;
    const Eigen::VectorXd k4 = model.A * (x + h * k3) + constant;
    x += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  return x;
}

class EveryModel : public testing::TestWithParam<int> {
 protected:
  ContinuousModel model() const {
    if (GetParam() == 0) return joint_model(reference_rig());
    return joint_model(paper_rig(GetParam() == 1 ? 2.0 : 0.0));
  }
};

TEST_P(EveryModel, AgreesWithNumericalIntegration) {
  const ContinuousModel continuous = model();
  for (const double period_s : {0.001, 0.005, 0.05}) {
    const SampledModel sampled = discretise(continuous.A, continuous.B, period_s);
    Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(continuous.order(), 0.7, -2.1);
    const double u = 3.7;
    const Eigen::Vector2d delta(0.3, -4.0);
    const Eigen::VectorXd next = sampled.A_star * x + sampled.B_star * u + sampled.D * delta;
    const Eigen::VectorXd expected = integrated(continuous, x, u, delta, period_s);
    EXPECT_LT((next - expected).cwiseAbs().maxCoeff(), 1e-11) << "T = " << period_s;
  }
}

INSTANTIATE_TEST_SUITE_P(Discretisation, EveryModel, testing::Values(0, 1, 2));

// u0 = 0: b1 = 0, A singular, the printed A⁻¹ does not exist. By hand, with f = 1 − e^{b2 T}:
// ∫e^{Aτ}dτ = [[T, (T − f/2)/2], [0, f/2]] for b2 = −2.
TEST(Discretisation, SingularModelByHand) {
  const double T = 0.005;
  const ContinuousModel model = joint_model(paper_rig(0.0));
  const SampledModel sampled = discretise(model.A, model.B, T);
  const double f = -std::expm1(-2.0 * T);
  EXPECT_NEAR(sampled.A_star(0, 0), 1.0, 1e-15);
  EXPECT_NEAR(sampled.A_star(0, 1), f / 2.0, 1e-15);
  EXPECT_NEAR(sampled.A_star(1, 0), 0.0, 1e-15);
  EXPECT_NEAR(sampled.A_star(1, 1), 1.0 - f, 1e-15);
  EXPECT_NEAR(sampled.D(0, 0), T, 1e-16);
  EXPECT_NEAR(sampled.D(0, 1), (T - f / 2.0) / 2.0, 1e-16);
  EXPECT_NEAR(sampled.D(1, 1), f / 2.0, 1e-16);
  EXPECT_NEAR(sampled.B_star(1), 0.99225 * f / 2.0, 1e-15);
}

// Where A⁻¹ exists, (20) as printed is the same thing.
TEST(Discretisation, AgreesWithThePrintedFormWhereThatExists) {
  const ContinuousModel model = joint_model(paper_rig(2.0));
  const SampledModel sampled = discretise(model.A, model.B, 0.005);
  const Eigen::MatrixXd printed =
      model.A.inverse() * (sampled.A_star - Eigen::MatrixXd::Identity(2, 2));
  EXPECT_LT((sampled.D - printed).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_LT((sampled.B_star - printed * model.B).cwiseAbs().maxCoeff(), 1e-15);
}

}  // namespace
}  // namespace eampc::law_design
