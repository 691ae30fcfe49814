#include "law_design/linear_program.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <random>

#include "law_design/half_spaces.hpp"

namespace eampc::law_design {
namespace {

TEST(LinearProgram, FindsTheCornerOfATriangle) {
  HalfSpaces rows(2);
  const std::array<double, 2> diagonal = {0.6, 0.8};
  rows.append(diagonal.data(), 0.5);
  LinearProgram program(2);
  const std::array<double, 2> c = {1.0, 1.0};
  const LpResult result = program.maximise(c.data(), rows);
  ASSERT_EQ(result.status, LpStatus::kOptimal);
  // 0.6·1 + 0.8 y = 0.5 gives y = −0.125; the other corner (−0.5, 1) is worth less.
  EXPECT_NEAR(program.point()[0], 1.0, 1e-12);
  EXPECT_NEAR(program.point()[1], -0.125, 1e-12);
  EXPECT_NEAR(result.value, 0.875, 1e-12);
}

TEST(LinearProgram, StopsOnceTheCutoffIsProved) {
  HalfSpaces rows(2);
  const std::array<double, 2> diagonal = {0.6, 0.8};
  rows.append(diagonal.data(), 0.5);
  LinearProgram program(2);
  const std::array<double, 2> c = {1.0, 1.0};
  EXPECT_EQ(program.maximise(c.data(), rows, 0.876).status, LpStatus::kBelowCutoff);
  EXPECT_EQ(program.maximise(c.data(), rows, 0.874).status, LpStatus::kOptimal);
}

TEST(LinearProgram, NamesAnEmptyPolytope) {
  HalfSpaces rows(3);
  const std::array<double, 3> up = {0.0, 0.0, 1.0};
  const std::array<double, 3> down = {0.0, 0.0, -1.0};
  rows.append(up.data(), 0.1);
  rows.append(down.data(), -0.1001);
  LinearProgram program(3);
  const std::array<double, 3> c = {1.0, 2.0, 3.0};
  EXPECT_EQ(program.maximise(c.data(), rows).status, LpStatus::kInfeasible);
}

// Oracle: in three dimensions the optimum is the best feasible one among the points where three
// of the rows (box included) are tight.
TEST(LinearProgram, AgreesWithTheBestVertexOfRandomPolytopes) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (int round = 0; round < 300; ++round) {
    Eigen::MatrixXd A(14, 3);
    Eigen::VectorXd b(14);
    HalfSpaces rows(3);
    for (Eigen::Index i = 0; i < 8; ++i) {
      for (Eigen::Index j = 0; j < 3; ++j) A(i, j) = normal(random);
      if (round % 3 == 0) A(i, i % 3) = 0.0;  // many parallel edges
      A.row(i).normalize();
      b(i) = 0.3 * normal(random) + 0.2;
      const std::array<double, 3> a = {A(i, 0), A(i, 1), A(i, 2)};
      rows.append(a.data(), b(i));
    }
    A.bottomRows(6) << 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1;
    b.tail(6).setOnes();
    const std::array<double, 3> c = {normal(random), round % 2 == 0 ? 0.0 : normal(random), 1.0};
    const Eigen::Vector3d objective(c[0], c[1], c[2]);
    double best = -1e9;
    for (Eigen::Index i = 0; i < 14; ++i) {
      for (Eigen::Index j = 0; j < i; ++j) {
        for (Eigen::Index k = 0; k < j; ++k) {
          Eigen::Matrix3d M;
          M << A.row(i), A.row(j), A.row(k);
          if (std::abs(M.determinant()) < 1e-9) continue;
          const Eigen::Vector3d x = M.partialPivLu().solve(Eigen::Vector3d(b(i), b(j), b(k)));
          if ((A * x - b).maxCoeff() < 1e-10) best = std::max(best, objective.dot(x));
        }
      }
    }
    LinearProgram program(3);
    const LpResult result = program.maximise(c.data(), rows);
    if (best == -1e9) {
      EXPECT_EQ(result.status, LpStatus::kInfeasible) << "round " << round;
    } else {
      ASSERT_EQ(result.status, LpStatus::kOptimal) << "round " << round;
      EXPECT_NEAR(result.value, best, 1e-9) << "round " << round;
    }
  }
}

}  // namespace
}  // namespace eampc::law_design
