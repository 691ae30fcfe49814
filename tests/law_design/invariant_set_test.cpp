#include "law_design/invariant_set.hpp"

#include <gtest/gtest.h>

#include "law_design/certificate_test_problems.hpp"

namespace eampc::law_design {
namespace {

// u = −x on |x| ≤ 2, |u| ≤ 1; x⁺ = 0.5 x + 0.25 u + w = 0.25 x + w. p = (x), no r.
ClosedLoop scalar_loop(double disturbance) {
  ClosedLoop loop;
  loop.A = Eigen::MatrixXd::Constant(1, 1, 0.5);
  loop.B = Eigen::VectorXd::Constant(1, 0.25);
  loop.A_parameters = Eigen::MatrixXd(1, 0);
  loop.input_offset = Eigen::VectorXd::Zero(1);
  loop.bound_rows = Eigen::MatrixXd(0, 1);
  loop.bounds = Eigen::VectorXd(0);
  loop.disturbance = Eigen::VectorXd::Constant(1, disturbance);
  return loop;
}

// By hand: |x| ≤ 1 (unsaturated) is kept if 0.25 + w ≤ 1.
TEST(InvariantSet, IsTheUnsaturatedIntervalOfAScalarLoop) {
  const MpQp problem = test::clipped_sum(1);
  const OutputLaw output = test::only_input(problem);
  const auto sets = test::clipped_sum_sets();
  for (const double w : {0.0, 0.5, 0.74}) {
    const InvariantSet set = invariant_set(problem, output, sets, scalar_loop(w), 4000, 1);
    ASSERT_TRUE(set.found) << set.statement;
    EXPECT_NEAR(set.spectral_radius, 0.25, 1e-14);
    EXPECT_NEAR(set.box_scaling, 0.5, 1e-9);
    EXPECT_NEAR(set.volume_fraction, 0.5, 0.05);
    EXPECT_EQ(set.set.size(), 2);
  }
  const InvariantSet none = invariant_set(problem, output, sets, scalar_loop(0.8), 100, 1);
  EXPECT_FALSE(none.found);
  EXPECT_NE(none.statement.find("empty"), std::string::npos) << none.statement;
}

// Simulated from its corners with the worst disturbances, the loop stays inside.
TEST(InvariantSet, IsKeptUnderTheWorstDisturbance) {
  const MpQp problem = test::clipped_sum(2);
  const OutputLaw output = test::only_input(problem);
  ClosedLoop loop;
  loop.A = Eigen::MatrixXd(2, 2);
  loop.A << 1.0, 0.2, 0.4, 1.0;
  loop.B = Eigen::Vector2d(0.4, 0.8);  // A − B (1 1) has the eigenvalues 0.2 and 0.6
  loop.A_parameters = Eigen::MatrixXd(2, 0);
  loop.input_offset = Eigen::VectorXd::Zero(2);
  loop.bound_rows = Eigen::MatrixXd(1, 2);
  loop.bound_rows << 1.0, 0.0;
  loop.bounds = Eigen::VectorXd::Constant(1, 0.8);
  loop.disturbance = Eigen::Vector2d(0.05, 0.02);
  const InvariantSet set = invariant_set(problem, output, test::clipped_sum_sets(), loop, 1000, 1);
  ASSERT_TRUE(set.found) << set.statement;
  EXPECT_LT(set.spectral_radius, 1.0);
  EXPECT_GT(set.box_scaling, 0.0);
  int inside = 0;
  for (int i = 0; i <= 40; ++i) {
    for (int j = 0; j <= 40; ++j) {
      const Eigen::Vector2d q(-1.0 + 0.05 * i, -1.0 + 0.05 * j);
      if (!set.set.contains(q.data(), 0.0)) continue;
      ++inside;
      const Eigen::Vector2d x = 2.0 * q;
      EXPECT_LE(std::abs(x.sum()), 1.0 + 1e-9);
      EXPECT_LE(x(0), 0.8 + 1e-9);
      for (const double w1 : {-0.05, 0.05}) {
        for (const double w2 : {-0.02, 0.02}) {
          const Eigen::Vector2d next =
              0.5 * (loop.A * x - loop.B * x.sum() + Eigen::Vector2d(w1, w2));
          EXPECT_TRUE(set.set.contains(next.data(), 1e-9)) << q.transpose();
        }
      }
    }
  }
  EXPECT_GT(inside, 50);
}

TEST(InvariantSet, SaysThatAnUnstableLoopHasNone) {
  const MpQp problem = test::clipped_sum(1);
  ClosedLoop loop = scalar_loop(0.0);
  loop.A(0, 0) = 3.0;
  const InvariantSet set =
      invariant_set(problem, test::only_input(problem), test::clipped_sum_sets(), loop, 10, 1);
  EXPECT_FALSE(set.found);
  EXPECT_FALSE(set.statement.empty());
  loop.B.resize(2);
  EXPECT_THROW(
      invariant_set(problem, test::only_input(problem), test::clipped_sum_sets(), loop, 10, 1),
      std::invalid_argument);
}

}  // namespace
}  // namespace eampc::law_design
