#include "law_design/linear_program.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <cstddef>
#include <random>

#include "law_design/half_spaces.hpp"
#include "law_design/largest_ball.hpp"

namespace eampc::law_design {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

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

// Rows that nearly contradict each other around a point that satisfies them all: whatever the
// program says of them must leave room for that point.
TEST(LinearProgram, NeverProvesAwayAPointOfANeedle) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int decided = 0;
  int optimal = 0;
  for (int round = 0; round < 4000; ++round) {
    const int n = 2 + round % 4;
    HalfSpaces rows(n);
    std::array<double, 5> inside{}, along{}, c{};
    double norm = 0.0;
    for (int j = 0; j < n; ++j) {
      inside[at(j)] = 0.9 * uniform(random);
      along[at(j)] = normal(random);
      c[at(j)] = normal(random);
      norm += along[at(j)] * along[at(j)];
    }
    const double spread = std::pow(10.0, -4.0 - round % 9);
    for (int i = 0; i < 2 * n + 4; ++i) {
      std::array<double, 5> a{};
      double length = 0.0;
      for (int j = 0; j < n; ++j) {
        a[at(j)] =
            (i % 2 == 0 ? 1.0 : -1.0) * along[at(j)] / std::sqrt(norm) + spread * normal(random);
        length += a[at(j)] * a[at(j)];
      }
      long double b = 0.0L;
      for (int j = 0; j < n; ++j) {
        a[at(j)] /= std::sqrt(length);
        b += static_cast<long double>(a[at(j)]) * inside[at(j)];
      }
      rows.append(a.data(), std::nextafter(static_cast<double>(b), 2.0));
    }
    double there = 0.0;
    for (int j = 0; j < n; ++j) there += c[at(j)] * inside[at(j)];
    LinearProgram program(n);
    const LpResult best = program.maximise(c.data(), rows);
    ASSERT_NE(best.status, LpStatus::kInfeasible) << "round " << round;
    if (best.status == LpStatus::kOptimal) {
      EXPECT_GE(best.value, there - 1e-12) << "round " << round;
      ++optimal;
    }
    const LpResult below = program.maximise(c.data(), rows, there - 1e-11);
    EXPECT_NE(below.status, LpStatus::kBelowCutoff) << "round " << round;
    EXPECT_NE(below.status, LpStatus::kInfeasible) << "round " << round;
    // A parallel row that excludes the whole needle.
    std::array<double, 5> a{};
    long double b = 0.0L;
    for (int j = 0; j < n; ++j) {
      a[at(j)] = -rows.normal(0, j);
      b += static_cast<long double>(a[at(j)]) * inside[at(j)];
    }
    rows.append(a.data(), static_cast<double>(b) - 1e-7);
    decided += program.maximise(c.data(), rows).status == LpStatus::kInfeasible ? 1 : 0;
  }
  EXPECT_GT(optimal, 3900);
  EXPECT_GE(decided, 3990);
}

// The largest ball of a region whose planes nearly coincide in pairs (1e-5 apart): the quick walk
// loses its way there. Radius 1/6 − 1/6000 by hand, from the last row against q3 ≤ 1.
TEST(LinearProgram, FindsTheBallOfARegionWithNearlyCoincidentPlanes) {
  const std::array<std::array<double, 5>, 8> planes = {{
      {0.69170023608725384, 0.20760916837575752, 2.9699565315280183e-08, -0.69170023608725384,
       -0.34102537866982435},
      {-0.2313118756463067, -0.91059698019164448, -0.2525921060441772, 0.2313118756463067,
       0.43478904252700074},
      {4.11658105614722e-05, 1.2212523799903428e-05, -0.99999999823080321, -4.11658105614722e-05,
       -0.50018659626384443},
      {0.95782628522115143, 0.28734788556634544, 0.0, 0.0, 0.47891314261057571},
      {0.69168472362789513, 0.20771250852945933, 6.2065366973200991e-08, -0.69168472362789513,
       -0.46139510825956853},
      {0.55211764443993738, 0.16379490118384801, -0.60291246772841178, -0.55211764443993738,
       0.10170681821037947},
      {0.95422304213853548, 0.28655260844799979, 8.562311883076551e-08, 0.085708741931723578,
       0.23043258425992125},
      {0.0, 0.0, -1.0, 0.0, -0.667},
  }};
  LargestBall ball(4);
  ball.set_perturbation(1e-10);
  for (const auto& plane : planes) ball.append(plane.data(), plane[4]);
  ASSERT_EQ(ball.find().status, LpStatus::kOptimal);
  EXPECT_NEAR(ball.radius(), 0.1665, 1e-9);
}

}  // namespace
}  // namespace eampc::law_design
