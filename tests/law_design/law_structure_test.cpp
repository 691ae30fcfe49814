#include "law_design/law_structure.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "law_design/mpqp_test_problems.hpp"
#include "service/law_packing.hpp"

namespace eampc::law_design {
namespace {

using test::benchmark_p5;
using test::degenerate_chain;
using test::first_input;
using test::random_parameter;
using test::region_at;

// The regions are judged by the problem's own optimality conditions in mpqp_test.cpp; here every
// value of the packed law is held against the region that contains the point, found by trying all.
void expect_law_equals_regions(const MpQp& problem, double bound, int count) {
  const MpQpSolution solution = solve_mpqp(problem);
  const LawStructure structure = build_law_structure(solution, first_input(problem, bound));
  const service::LawPacking packing(structure.tables);
  std::mt19937 random(17);
  double worst = 0.0;
  int held = 0;
  const auto compare = [&](const Eigen::VectorXd& p) {
    const int r = region_at(solution, p, 1e-11);
    if (r < 0) return;
    ++held;
    const CriticalRegion& region = solution.regions[static_cast<std::size_t>(r)];
    const double u = region.gain.row(0).dot(p) + region.offset(0);
    const double found = control::evaluate(packing.law(), p.data()).u;
    worst =
        std::max(worst, std::abs(std::clamp(u, -bound, bound) - std::clamp(found, -bound, bound)));
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

TEST(LawStructure, EqualsTheRegionsOfTheBenchmark) {
  expect_law_equals_regions(benchmark_p5(5, 2.0), 4.0, 5000);
  expect_law_equals_regions(benchmark_p5(10, 2.0), 4.0, 5000);
  expect_law_equals_regions(benchmark_p5(20, 2.0), 4.0, 2000);
  expect_law_equals_regions(benchmark_p5(10, 0.0), 4.0, 5000);
}

TEST(LawStructure, EqualsTheRegionsOfDegenerateChains) {
  for (unsigned seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    expect_law_equals_regions(degenerate_chain(seed), 1.0, 1000);
  }
}

// With one unsaturated region the exact law is clip(K θ); a generator that drops saturated regions
// without proof is known to return the bound itself here.
TEST(LawStructure, OneUnsaturatedRegionIsItsClippedLaw) {
  const MpQp problem = benchmark_p5(3, 0.0);
  const LawStructure structure =
      build_law_structure(solve_mpqp(problem), first_input(problem, 4.0));
  EXPECT_EQ(structure.distinct_laws, 1);
  EXPECT_EQ(structure.tables.root, -1);
  EXPECT_EQ(structure.tables.term_pieces.size(), 1U);
  expect_law_equals_regions(problem, 4.0, 5000);
}

// A tighter clip than the problem's own input bound saturates inside regions.
TEST(LawStructure, ClipsInsideRegionsToo) {
  expect_law_equals_regions(benchmark_p5(5, 2.0), 2.5, 5000);
}

// All regions of this benchmark share so few pieces that hardly any hyperplane is needed.
TEST(LawStructure, FewPiecesAreOneLattice) {
  const LawStructure structure =
      build_law_structure(solve_mpqp(benchmark_p5(5, 0.0)), first_input(benchmark_p5(5, 0.0), 4.0));
  EXPECT_LE(structure.tables.n_leaves(), 2U);
}

TEST(LawStructure, DoesNotDependOnTheNumberOfThreads) {
  const MpQp problem = benchmark_p5(20, 2.0);
  const MpQpSolution solution = solve_mpqp(problem);
  LawStructureOptions options;
  options.threads = 1;
  const LawStructure one = build_law_structure(solution, first_input(problem, 4.0), options);
  options.threads = 3;
  const LawStructure three = build_law_structure(solution, first_input(problem, 4.0), options);
  EXPECT_EQ(one.tables.hyperplanes, three.tables.hyperplanes);
  EXPECT_EQ(one.tables.node_planes, three.tables.node_planes);
  EXPECT_EQ(one.tables.node_children, three.tables.node_children);
  EXPECT_EQ(one.tables.leaf_bits, three.tables.leaf_bits);
  EXPECT_EQ(one.tables.term_pieces, three.tables.term_pieces);
  EXPECT_EQ(one.tables.piece_gain, three.tables.piece_gain);
}

TEST(LawStructure, CanBeCancelled) {
  const MpQp problem = benchmark_p5(20, 2.0);
  LawStructureOptions options;
  options.progress = [](long, long) { return false; };
  EXPECT_THROW(build_law_structure(solve_mpqp(problem), first_input(problem, 4.0), options),
               Cancelled);
}

TEST(LawStructure, RefusesAnOutputThatMakesNoSense) {
  const MpQp problem = benchmark_p5(10, 0.0);
  MpQpSolution solution = solve_mpqp(problem);
  const OutputLaw output = first_input(problem, 4.0);
  OutputLaw wrong = output;
  wrong.y_max = wrong.y_min;
  EXPECT_THROW(build_law_structure(solution, wrong), std::invalid_argument);
  wrong = output;
  wrong.Y_p = Eigen::RowVectorXd::Zero(2);
  EXPECT_THROW(build_law_structure(solution, wrong), std::invalid_argument);
  solution.regions.clear();
  EXPECT_THROW(build_law_structure(solution, output), std::invalid_argument);
}

// Cells without any region would look like parameters without a solution.
TEST(LawStructure, RefusesASolutionWithoutItsSaturatedRegions) {
  const MpQp problem = benchmark_p5(10, 2.0);
  MpQpOptions options;
  options.output = first_input(problem, 4.0);
  EXPECT_THROW(build_law_structure(solve_mpqp(problem, options), *options.output),
               std::invalid_argument);
}

}  // namespace
}  // namespace eampc::law_design
