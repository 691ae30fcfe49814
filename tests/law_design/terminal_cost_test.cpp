#include "law_design/terminal_cost.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "law_design/design_error.hpp"
#include "law_design/discretisation.hpp"
#include "law_design/joint_model.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

// Scalar Riccati equation by hand: p = q + a²p − a²p²/(r + p) with a = 2, q = 3, r = 1 (b = 1)
// gives p² − 6p − 3 = 0, p = 3 + √12.
TEST(TerminalCost, ScalarByHand) {
  const auto scalar = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  const Eigen::MatrixXd P = riccati_solution(scalar(2.0), scalar(1.0), scalar(3.0), scalar(1.0));
  EXPECT_NEAR(P(0, 0), 3.0 + std::sqrt(12.0), 1e-12);
}

TEST(TerminalCost, SolvesTheEquationForTheReferenceRig) {
  const ContinuousModel continuous = joint_model(reference_rig());
  const SampledModel model = discretise(continuous.A, continuous.B, 0.005);
  const Eigen::MatrixXd Q = Eigen::Vector3d(100.0, 0.5, 0.0).asDiagonal();
  const Eigen::MatrixXd R = Eigen::MatrixXd::Constant(1, 1, 0.01);
  const Eigen::MatrixXd A = model.A_star, B = model.B_star;
  const Eigen::MatrixXd P = riccati_solution(A, B, Q, R);
  const Eigen::MatrixXd BtPA = B.transpose() * P * A;
  const Eigen::MatrixXd K = (R + B.transpose() * P * B).inverse() * BtPA;
  const Eigen::MatrixXd residual = Q + A.transpose() * P * A - BtPA.transpose() * K - P;
  EXPECT_LT(residual.cwiseAbs().maxCoeff(), 1e-9 * P.cwiseAbs().maxCoeff());
  EXPECT_LT((A - B * K).eigenvalues().cwiseAbs().maxCoeff(), 1.0);
}

TEST(TerminalCost, UnreachableUnstableModeIsRefused) {
  const Eigen::MatrixXd A = Eigen::Vector2d(1.5, 0.5).asDiagonal();
  const Eigen::MatrixXd B = Eigen::Vector2d(0.0, 1.0);
  EXPECT_THROW(
      riccati_solution(A, B, Eigen::MatrixXd::Identity(2, 2), Eigen::MatrixXd::Constant(1, 1, 1.0)),
      DesignError);
}

}  // namespace
}  // namespace eampc::law_design
