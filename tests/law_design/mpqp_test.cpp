#include "law_design/mpqp.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "law_design/mpqp_test_problems.hpp"

namespace eampc::law_design {
namespace {

using test::benchmark_p5;
using test::degenerate_chain;
using test::optimality_gap;
using test::random_parameter;
using test::region_at;

// min ½u² + p·u with |u| ≤ 1 on |p| ≤ 2: u = clip(−p). By hand.
MpQp saturated_line() {
  MpQp problem;
  problem.H = Eigen::MatrixXd::Identity(1, 1);
  problem.F = Eigen::MatrixXd::Identity(1, 1);
  problem.f = Eigen::VectorXd::Zero(1);
  problem.G = Eigen::MatrixXd(2, 1);
  problem.G << 1.0, -1.0;
  problem.w = Eigen::VectorXd::Ones(2);
  problem.S = Eigen::MatrixXd::Zero(2, 1);
  problem.lower = Eigen::VectorXd::Constant(1, -2.0);
  problem.upper = Eigen::VectorXd::Constant(1, 2.0);
  return problem;
}

TEST(MpQp, SolvesASaturatedLineAsByHand) {
  const MpQpSolution solution = solve_mpqp(saturated_line());
  ASSERT_EQ(solution.regions.size(), 3U);
  EXPECT_FALSE(solution.has_infeasible_parameters);
  for (const double p : {-2.0, -1.5, -1.0, -0.3, 0.0, 0.8, 1.0, 1.7, 2.0}) {
    const int r = region_at(solution, Eigen::VectorXd::Constant(1, p));
    ASSERT_GE(r, 0) << p;
    const CriticalRegion& region = solution.regions[static_cast<std::size_t>(r)];
    EXPECT_NEAR(region.gain(0, 0) * p + region.offset(0), std::clamp(-p, -1.0, 1.0), 1e-12);
  }
}

TEST(MpQp, RecordsParametersWithoutASolution) {
  MpQp problem = saturated_line();
  problem.S << 1.0, 1.0;  // −(1 + p) ≤ u ≤ 1 + p: empty below p = −1
  const MpQpSolution solution = solve_mpqp(problem);
  EXPECT_TRUE(solution.has_infeasible_parameters);
  EXPECT_LT(region_at(solution, Eigen::VectorXd::Constant(1, -1.1)), 0);
  EXPECT_GE(region_at(solution, Eigen::VectorXd::Constant(1, -0.9)), 0);
}

TEST(MpQp, RefusesWhatItCannotSolve) {
  MpQp problem = saturated_line();
  problem.H(0, 0) = 0.0;
  EXPECT_THROW(solve_mpqp(problem), std::invalid_argument);
  problem = saturated_line();
  problem.w << -1.0, -1.0;
  EXPECT_THROW(solve_mpqp(problem), std::invalid_argument);
  problem = saturated_line();
  problem.upper = problem.lower;
  EXPECT_THROW(solve_mpqp(problem), std::invalid_argument);
  MpQpOptions options;
  options.max_regions = 2;
  EXPECT_THROW(solve_mpqp(saturated_line(), options), std::runtime_error);
  options = {};
  options.time_limit_s = 1e-9;
  EXPECT_THROW(solve_mpqp(saturated_line(), options), TimeLimit);
  options = {};
  options.progress = [](int, int) { return false; };
  EXPECT_THROW(solve_mpqp(saturated_line(), options), Cancelled);
}

// A row may be dropped only if no other copy of it was dropped for its sake.
TEST(MpQp, KeepsOneOfTwoEqualRows) {
  MpQp problem = saturated_line();
  problem.G = Eigen::MatrixXd(4, 1);
  problem.G << 1.0, -1.0, 3.0, 1.0;
  problem.w = Eigen::Vector4d(1.0, 1.0, 3.0, 1.0);
  problem.S = Eigen::MatrixXd::Zero(4, 1);
  const MpQpSolution solution = solve_mpqp(problem);
  EXPECT_EQ(solution.regions.size(), 3U);
  EXPECT_EQ(solution.statistics.rows_kept, 2);
}

/// Checks every feasible one of `count` random parameters; returns how many were feasible.
int expect_optimal_everywhere(const MpQp& problem, const MpQpSolution& solution, int count,
                              double tolerance) {
  // A solution of the widened problem exists at every parameter, so a parameter is feasible if
  // the law says so or if the region next to it would have to be larger: both show as a hole,
  // which is then judged by how far any U can satisfy the rows.
  std::mt19937 random(11);
  int held = 0;
  double worst = 0.0;
  for (int i = 0; i < count; ++i) {
    const Eigen::VectorXd p = random_parameter(problem, random);
    const int r = region_at(solution, p);
    if (r < 0) continue;
    ++held;
    const CriticalRegion& region = solution.regions[static_cast<std::size_t>(r)];
    worst = std::max(worst, optimality_gap(problem, p, region.gain * p + region.offset));
  }
  EXPECT_LT(worst, tolerance);
  return held;
}

/// True if some U satisfies G U ≤ w + S p: von Neumann's test by projections (Agmon's relaxation),
/// run until it converges or stalls. Nothing of the solver is used.
bool some_input_is_feasible(const MpQp& problem, const Eigen::VectorXd& p, double margin) {
  const Eigen::VectorXd right = problem.w + problem.S * p;
  Eigen::VectorXd U = Eigen::VectorXd::Zero(problem.H.rows());
  for (int round = 0; round < 20000; ++round) {
    double worst = 0.0;
    Eigen::Index row = -1;
    for (Eigen::Index i = 0; i < right.size(); ++i) {
      const double norm = problem.G.row(i).norm();
      if (norm == 0.0) {
        if (right(i) < 0.0) return false;
        continue;
      }
      const double violation = (problem.G.row(i).dot(U) - right(i)) / norm + margin;
      if (violation > worst) {
        worst = violation;
        row = i;
      }
    }
    if (row < 0) return true;
    U -= 1.5 * worst * problem.G.row(row).transpose() / problem.G.row(row).norm();
  }
  return false;
}

TEST(MpQp, BenchmarkIsOptimalAndWithoutHoles) {
  for (const double u0 : {2.0, 0.0}) {
    for (const int N : {5, 10}) {
      const MpQp problem = benchmark_p5(N, u0);
      const MpQpSolution solution = solve_mpqp(problem);
      // The published counts: 125 and 363 for u0 = 2, 77 for u0 = 0 and N = 10; tools differ by a
      // few slivers.
      const int expected = u0 > 0.0 ? (N == 5 ? 125 : 363) : (N == 5 ? 19 : 77);
      EXPECT_NEAR(solution.statistics.regions, expected, 5) << "u0 " << u0 << ", N " << N;
      EXPECT_GT(expect_optimal_everywhere(problem, solution, 2000, 1e-8 * 8.0), 1000);
      std::mt19937 random(3);
      int holes = 0;
      for (int i = 0; i < 200; ++i) {
        const Eigen::VectorXd p = random_parameter(problem, random);
        if (region_at(solution, p) < 0 && some_input_is_feasible(problem, p, 1e-6)) ++holes;
      }
      EXPECT_EQ(holes, 0) << "u0 " << u0 << ", N " << N;
    }
  }
}

TEST(MpQp, FortyDegenerateChainsAreOptimalAndWithoutHoles) {
  for (unsigned seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    const MpQp problem = degenerate_chain(seed);
    const MpQpSolution solution = solve_mpqp(problem);
    EXPECT_TRUE(solution.has_infeasible_parameters);
    EXPECT_LT(solution.statistics.rows_kept, static_cast<int>(problem.G.rows()) - 8);
    EXPECT_GT(expect_optimal_everywhere(problem, solution, 500, 1e-7), 30);
    std::mt19937 random(seed);
    for (int i = 0; i < 30; ++i) {
      const Eigen::VectorXd p = random_parameter(problem, random);
      if (region_at(solution, p) < 0) {
        EXPECT_FALSE(some_input_is_feasible(problem, p, 1e-6)) << p.transpose();
      }
    }
  }
}

TEST(MpQp, IsTheSameForAnyNumberOfThreads) {
  for (const MpQp& problem : {benchmark_p5(10, 2.0), degenerate_chain(5)}) {
    MpQpOptions options;
    options.threads = 1;
    const MpQpSolution a = solve_mpqp(problem, options);
    for (const int threads : {2, 3}) {
      options.threads = threads;
      const MpQpSolution b = solve_mpqp(problem, options);
      ASSERT_EQ(a.regions.size(), b.regions.size());
      for (std::size_t r = 0; r < a.regions.size(); ++r) {
        EXPECT_EQ(a.regions[r].active_set, b.regions[r].active_set);
        EXPECT_EQ(a.regions[r].gain, b.regions[r].gain);
        EXPECT_EQ(a.regions[r].facet_normals, b.regions[r].facet_normals);
        EXPECT_EQ(a.regions[r].neighbours, b.regions[r].neighbours);
      }
    }
  }
}

// |u| ≤ 1 + p0 and p1 ≤ 1: below p0 = −1 rows contradict each other, above p1 = 1 one row fails.
TEST(MpQp, SaysWhatLiesBeyondEveryFacet) {
  MpQp problem;
  problem.H = Eigen::MatrixXd::Identity(1, 1);
  problem.F = Eigen::MatrixXd(1, 2);
  problem.F << 1.0, 1.0;
  problem.f = Eigen::VectorXd::Zero(1);
  problem.G = Eigen::MatrixXd(3, 1);
  problem.G << 1.0, -1.0, 0.0;
  problem.w = Eigen::VectorXd::Ones(3);
  problem.S = Eigen::MatrixXd(3, 2);
  problem.S << 1.0, 0.0, 1.0, 0.0, 0.0, -1.0;
  problem.lower = Eigen::Vector2d(-2.0, -2.0);
  problem.upper = Eigen::Vector2d(2.0, 2.0);
  const MpQpSolution solution = solve_mpqp(problem);
  EXPECT_TRUE(solution.has_infeasible_parameters);
  int infeasible = 0, parameter_row = 0;
  for (const CriticalRegion& region : solution.regions) {
    for (std::size_t f = 0; f < region.facet_kinds.size(); ++f) {
      const Eigen::RowVectorXd normal = region.facet_normals.row(static_cast<Eigen::Index>(f));
      const double offset = region.facet_offsets(static_cast<Eigen::Index>(f));
      switch (region.facet_kinds[f]) {
        case FacetKind::kInfeasible:
          ++infeasible;
          EXPECT_NEAR(normal(0), -1.0, 1e-12);
          EXPECT_NEAR(offset, 1.0, 1e-12);
          break;
        case FacetKind::kParameterRow:
          ++parameter_row;
          EXPECT_NEAR(normal(1), 1.0, 1e-12);
          EXPECT_NEAR(offset, 1.0, 1e-12);
          break;
        case FacetKind::kBox:
          EXPECT_NEAR(offset, 2.0, 1e-12);
          EXPECT_TRUE(region.neighbours[f].empty());
          break;
        default:
          EXPECT_FALSE(region.neighbours[f].empty());
      }
    }
  }
  EXPECT_GT(infeasible, 0);
  EXPECT_GT(parameter_row, 0);
}

// |u0| + u2 ≤ 1 and |u1| + u2 ≤ 1, pulled up: on a part of the parameters all four rows are tight
// for three inputs, and any three of them are an active set of the one solution (0, 0, 1).
MpQp roof() {
  MpQp problem;
  problem.H = Eigen::MatrixXd::Identity(3, 3);
  problem.F = -Eigen::MatrixXd::Identity(3, 2);
  problem.f = Eigen::Vector3d(0.0, 0.0, -2.0);
  problem.G = Eigen::MatrixXd(4, 3);
  problem.G << 1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0;
  problem.w = Eigen::VectorXd::Ones(4);
  problem.S = Eigen::MatrixXd::Zero(4, 2);
  problem.lower = Eigen::Vector2d(-2.0, -2.0);
  problem.upper = Eigen::Vector2d(2.0, 2.0);
  return problem;
}

TEST(MpQp, OneOfSeveralActiveSetsHoldsEachParameter) {
  const MpQp problem = roof();
  const MpQpSolution solution = solve_mpqp(problem);
  int at_the_top = 0;
  for (const CriticalRegion& region : solution.regions) {
    if (region.gain.norm() > 1e-12) continue;
    ++at_the_top;
    EXPECT_LT((region.offset - Eigen::Vector3d(0.0, 0.0, 1.0)).norm(), 1e-12);
  }
  EXPECT_GE(at_the_top, 1);
  for (double x = -1.95; x < 2.0; x += 0.1) {
    for (double y = -1.93; y < 2.0; y += 0.1) {
      const Eigen::Vector2d p(x, y);
      int holders = 0;
      for (const CriticalRegion& region : solution.regions) {
        if ((region.facet_normals * p - region.facet_offsets).maxCoeff() > -1e-9) continue;
        ++holders;
        EXPECT_LT(optimality_gap(problem, p, region.gain * p + region.offset), 1e-9);
      }
      EXPECT_EQ(holders, 1) << p.transpose();
    }
  }
}

// Where more rows are tight than there are inputs, several active sets describe one solution.
TEST(MpQp, RegionsDoNotOverlapWhereRowsDepend) {
  long flat = 0;
  for (unsigned seed = 0; seed <= 40; ++seed) {
    SCOPED_TRACE(seed);
    const MpQp problem = seed < 40 ? degenerate_chain(seed) : benchmark_p5(8, 2.0);
    const MpQpSolution solution = solve_mpqp(problem);
    flat += solution.statistics.flat_active_sets;
    std::mt19937 random(seed);
    for (int i = 0; i < 300; ++i) {
      const Eigen::VectorXd p = random_parameter(problem, random);
      int holders = 0;
      for (const CriticalRegion& region : solution.regions) {
        holders += (region.facet_normals * p - region.facet_offsets).maxCoeff() < -1e-7 ? 1 : 0;
      }
      EXPECT_LE(holders, 1) << p.transpose();
    }
  }
  EXPECT_GT(flat, 400);
}

// Leaving out saturated regions must not lose an unsaturated one.
TEST(MpQp, UnsaturatedRegionsAreTheSameWithAndWithoutTheOthers) {
  const MpQp problem = benchmark_p5(10, 2.0);
  MpQpOptions options;
  options.output = test::first_input(problem, 4.0);
  const MpQpSolution all = solve_mpqp(problem);
  const MpQpSolution some = solve_mpqp(problem, options);
  std::vector<std::vector<int>> expected, found;
  for (const CriticalRegion& region : all.regions) {
    if (region.gain.row(0).norm() > 1e-9) expected.push_back(region.active_set);
  }
  for (const CriticalRegion& region : some.regions) found.push_back(region.active_set);
  std::sort(expected.begin(), expected.end());
  std::sort(found.begin(), found.end());
  EXPECT_LT(found.size(), all.regions.size());
  EXPECT_EQ(found, expected);
}

}  // namespace
}  // namespace eampc::law_design
