#include "law_design/search_tree.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "law_design/mpqp_test_problems.hpp"

namespace eampc::law_design {
namespace {

using test::benchmark_p5;
using test::degenerate_chain;
using test::first_input;
using test::random_parameter;
using test::region_at;

double clipped(const BuiltSearchTree& tree, const Eigen::VectorXd& p, double bound) {
  return std::clamp(evaluate(tree.view(), p.data()).u, -bound, bound);
}

// The regions are judged by the problem's own optimality conditions in mpqp_test.cpp; here every
// value of the tree is held against the region that contains the point, found by trying all.
void expect_tree_equals_regions(const MpQp& problem, double bound, int count) {
  const MpQpSolution solution = solve_mpqp(problem);
  const BuiltSearchTree tree = build_search_tree(solution, first_input(problem, bound));
  std::mt19937 random(17);
  double worst = 0.0;
  int held = 0;
  const auto compare = [&](const Eigen::VectorXd& p) {
    const int r = region_at(solution, p, 1e-11);
    if (r < 0) return;
    ++held;
    const CriticalRegion& region = solution.regions[static_cast<std::size_t>(r)];
    const double u = region.gain.row(0).dot(p) + region.offset(0);
    worst = std::max(worst, std::abs(std::clamp(u, -bound, bound) - clipped(tree, p, bound)));
  };
  for (int i = 0; i < count; ++i) compare(random_parameter(problem, random));
  // Near facets, where a wrong side would show.
  for (const CriticalRegion& region : solution.regions) {
    for (Eigen::Index f = 0; f < region.facet_offsets.size(); ++f) {
      const Eigen::VectorXd a = region.facet_normals.row(f).transpose();
      const double distance = region.facet_offsets(f) - a.dot(region.interior);
      for (const double beyond : {-1e-7, 0.0, 1e-7}) {
        compare(region.interior + (distance + beyond) * a);
      }
    }
  }
  EXPECT_GT(held, count / 20);
  EXPECT_LT(worst, 1e-6 * 2.0 * bound);
}

TEST(SearchTree, EqualsTheRegionsOfTheBenchmark) {
  expect_tree_equals_regions(benchmark_p5(5, 2.0), 4.0, 5000);
  expect_tree_equals_regions(benchmark_p5(10, 2.0), 4.0, 5000);
  expect_tree_equals_regions(benchmark_p5(10, 0.0), 4.0, 5000);
}

TEST(SearchTree, EqualsTheRegionsOfDegenerateChains) {
  for (unsigned seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    expect_tree_equals_regions(degenerate_chain(seed), 1.0, 1000);
  }
}

// With one unsaturated region the exact law is clip(K θ); a generator that drops saturated regions
// without proof is known to return the bound itself here.
TEST(SearchTree, OneUnsaturatedRegionIsItsClippedLaw) {
  const MpQp problem = benchmark_p5(3, 0.0);
  const BuiltSearchTree tree = build_search_tree(solve_mpqp(problem), first_input(problem, 4.0));
  EXPECT_EQ(tree.statistics.distinct_laws, 1);
  EXPECT_TRUE(tree.nodes.empty());
  expect_tree_equals_regions(problem, 4.0, 5000);
}

// A tighter clip than the problem's own input bound saturates inside regions.
TEST(SearchTree, ClipsInsideRegionsToo) {
  expect_tree_equals_regions(benchmark_p5(5, 2.0), 2.5, 5000);
}

TEST(SearchTree, SolutionWithoutSaturatedRegionsGivesTheSameLaw) {
  const MpQp problem = benchmark_p5(10, 2.0);
  MpQpOptions options;
  options.output = first_input(problem, 4.0);
  const BuiltSearchTree all = build_search_tree(solve_mpqp(problem), *options.output);
  const MpQpSolution full = solve_mpqp(problem);
  const BuiltSearchTree some = build_search_tree(solve_mpqp(problem, options), *options.output);
  std::mt19937 random(5);
  for (int i = 0; i < 5000; ++i) {
    const Eigen::VectorXd p = random_parameter(problem, random);
    if (region_at(full, p) < 0) continue;
    EXPECT_NEAR(clipped(all, p, 4.0), clipped(some, p, 4.0), 1e-9);
  }
}

TEST(SearchTree, DepthBoundsEveryPath) {
  const MpQp problem = benchmark_p5(10, 2.0);
  const BuiltSearchTree tree = build_search_tree(solve_mpqp(problem), first_input(problem, 4.0));
  const auto depth = [&](auto&& self, std::int32_t child) -> int {
    if (child < 0) return 0;
    const SplitNode& node = tree.nodes[static_cast<std::size_t>(child)];
    return 1 + std::max(self(self, node.below), self(self, node.above));
  };
  EXPECT_EQ(depth(depth, tree.root), tree.depth);
}

TEST(SearchTree, RefusesASolutionWithAHole) {
  const MpQp problem = benchmark_p5(10, 0.0);
  MpQpSolution solution = solve_mpqp(problem);
  const OutputLaw output = first_input(problem, 4.0);
  OutputLaw wrong = output;
  wrong.y_max = wrong.y_min;
  EXPECT_THROW(build_search_tree(solution, wrong), std::invalid_argument);
  wrong = output;
  wrong.Y_p = Eigen::RowVectorXd::Zero(2);
  EXPECT_THROW(build_search_tree(solution, wrong), std::invalid_argument);
  solution.regions.clear();
  EXPECT_THROW(build_search_tree(solution, output), std::invalid_argument);
}

TEST(BinaryTree, FollowsTheSidesOfAHandMadeTree) {
  // u = 2 p0 + 1 where p0 + p1 ≤ 1, else −3 p1 where p1 ≤ 0.5, else 7.
  const std::array<SplitNode, 2> nodes = {{{{1.0, 1.0}, 1.0, ~0, 1}, {{0.0, 1.0}, 0.5, ~1, ~2}}};
  const std::array<AffinePiece, 3> pieces = {{{{2.0, 0.0}, 1.0}, {{0.0, -3.0}, 0.0}, {{}, 7.0}}};
  BinaryTree tree{nodes, pieces, 2, 2, 0};
  const auto at = [&](double x, double y) {
    const std::array<double, 2> p = {x, y};
    return evaluate(tree, p.data());
  };
  EXPECT_EQ(at(0.25, 0.5).u, 1.5);
  EXPECT_EQ(at(0.5, 0.5).piece, 0);  // on the plane: below
  EXPECT_EQ(at(2.0, 0.25).u, -0.75);
  EXPECT_EQ(at(2.0, 0.75).u, 7.0);
  EXPECT_EQ(at(2.0, 0.75).piece, 2);
  // Ends within the stated depth whatever the input.
  EXPECT_EQ(at(std::numeric_limits<double>::quiet_NaN(), 0.0).piece, 2);
  tree.depth = 1;
  EXPECT_EQ(at(2.0, 0.75).piece, -1);
  EXPECT_TRUE(std::isnan(at(2.0, 0.75).u));
}

}  // namespace
}  // namespace eampc::law_design
