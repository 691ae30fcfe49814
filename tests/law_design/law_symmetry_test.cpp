#include "law_design/law_symmetry.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <random>
#include <vector>

#include "law_design/law_certificate.hpp"
#include "law_design/law_structure.hpp"
#include "law_design/mpqp_test_problems.hpp"
#include "service/law_packing.hpp"

namespace eampc::law_design {
namespace {

using test::benchmark_p5;
using test::first_input;
using test::random_parameter;

LawPartition partition_of(const MpQp& problem, double bound) {
  return partition_by_law(solve_mpqp(problem), first_input(problem, bound));
}

bool some_region_holds(const LawPartition& partition, const Point& q, double tolerance) {
  return std::any_of(
      partition.regions.begin(), partition.regions.end(),
      [&](const LawRegion& region) { return region.facets.contains(q.data(), tolerance); });
}

TEST(LawSymmetry, HalfOfAnOddLawIsWhatLiesAboveTheFold) {
  const LawPartition whole = partition_of(benchmark_p5(10, 2.0), 4.0);
  const std::optional<Hyperplane> fold = odd_symmetry(whole);
  ASSERT_TRUE(fold);
  EXPECT_EQ(fold->offset, 0.0);
  const LawPartition half = half_above(whole, *fold);
  EXPECT_LT(half.regions.size(), 2 * whole.regions.size() / 3);
  EXPECT_GE(2 * half.regions.size(), whole.regions.size());

  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int above = 0;
  for (int i = 0; i < 4000; ++i) {
    Point q{};
    for (int j = 0; j < whole.parameters; ++j) q[static_cast<std::size_t>(j)] = uniform(random);
    const double excess = fold->excess(q);
    if (excess < -1e-6) {
      EXPECT_FALSE(some_region_holds(half, q, 0.0));
    } else if (excess > 1e-6) {
      EXPECT_EQ(some_region_holds(half, q, 1e-10), some_region_holds(whole, q, 1e-10));
      above += some_region_holds(whole, q, 1e-10) ? 1 : 0;
    }
  }
  EXPECT_GT(above, 200);
}

// A ball and extreme points are known of every region of the half; they must lie in it.
TEST(LawSymmetry, RegionsThatTheFoldCutsAreMeasuredAnew) {
  const LawPartition whole = partition_of(benchmark_p5(10, 2.0), 4.0);
  const std::optional<Hyperplane> fold = odd_symmetry(whole);
  ASSERT_TRUE(fold);
  int cut = 0;
  for (const LawRegion& region : half_above(whole, *fold).regions) {
    EXPECT_GE(fold->excess(region.inside), region.radius - 1e-9);
    for (const Point& point : region.extent.points) {
      EXPECT_GE(fold->excess(point), -1e-9);
      EXPECT_TRUE(region.facets.contains(point.data(), 1e-9));
      for (int j = 0; j < whole.parameters; ++j) {
        const auto k = static_cast<std::size_t>(j);
        EXPECT_GE(point[k], region.extent.lower[k] - 1e-9);
        EXPECT_LE(point[k], region.extent.upper[k] + 1e-9);
      }
    }
    const int last = region.facets.size() - 1;
    cut += region.facets.offset(last) == 0.0 ? 1 : 0;
  }
  EXPECT_GT(cut, 0);
}

// Ties between active sets may divide a region on one side of the fold only.
TEST(LawSymmetry, ADividedRegionIsOddIfItsMirrorImageHoldsItsLaw) {
  LawPartition whole = partition_of(benchmark_p5(20, 2.0), 4.0);
  const std::optional<Hyperplane> fold = odd_symmetry(whole);
  ASSERT_TRUE(fold);
  const std::size_t before = half_above(whole, *fold).regions.size();

  const auto below = [&](const LawRegion& region) {
    return !whole.is_bound(region.law) && region.radius > 1e-3 &&
           std::all_of(region.extent.points.begin(), region.extent.points.end(),
                       [&](const Point& q) { return fold->excess(q) < -1e-3; });
  };
  const auto found = std::find_if(whole.regions.begin(), whole.regions.end(), below);
  ASSERT_NE(found, whole.regions.end());
  const LawRegion divided = *found;
  whole.regions.erase(found);
  for (const double side : {1.0, -1.0}) {
    LawRegion part = divided;
    Point normal{};
    normal[0] = side;
    part.facets.append(normal.data(), side * divided.inside[0]);
    part.inside[0] -= side * 0.25 * divided.radius;
    part.radius = 0.25 * divided.radius;
    whole.regions.push_back(part);
  }
  ASSERT_TRUE(odd_symmetry(whole));
  const LawPartition half = half_above(whole, *fold);
  ASSERT_EQ(half.regions.size(), before + 2);
  for (const std::size_t back : {1U, 2U}) {
    const LawRegion& image = half.regions[half.regions.size() - back];
    const LawRegion& part = whole.regions[whole.regions.size() - back];
    EXPECT_GT(fold->excess(image.inside), 0.0);
    for (std::size_t j = 0; j < 5; ++j) EXPECT_EQ(image.inside[j], -part.inside[j]);
    EXPECT_NEAR(half.value(image.law, image.inside.data()),
                1.0 - whole.value(part.law, part.inside.data()), 1e-9);
  }

  whole.regions.back().law = whole.is_bound(0) ? 1 : 0;
  EXPECT_FALSE(odd_symmetry(whole));
}

TEST(LawSymmetry, NothingIsOddByHalves) {
  MpQp problem = benchmark_p5(5, 2.0);
  const LawPartition odd = partition_of(problem, 4.0);
  ASSERT_TRUE(odd_symmetry(odd));

  LawPartition changed = odd;
  changed.y_min = -3.9;
  EXPECT_FALSE(odd_symmetry(changed));
  changed = odd;
  changed.centre(0) = 1e-3;
  EXPECT_FALSE(odd_symmetry(changed));
  changed = odd;
  ASSERT_FALSE(changed.is_bound(0));
  changed.laws[0][0] += 1e-6;
  EXPECT_FALSE(odd_symmetry(changed));
  changed = odd;
  changed.regions.pop_back();
  EXPECT_FALSE(odd_symmetry(changed));
  changed = odd;
  changed.regions.back().facets.set_offset(0, changed.regions.back().facets.offset(0) + 1e-6);
  EXPECT_FALSE(odd_symmetry(changed));

  problem.f.setConstant(0.1);
  EXPECT_FALSE(odd_symmetry(partition_of(problem, 4.0)));
}

TEST(LawSymmetry, AFoldedLawIsOddToTheBit) {
  const MpQp problem = benchmark_p5(20, 2.0);
  const LawStructure structure =
      build_law_structure(solve_mpqp(problem), first_input(problem, 4.0));
  EXPECT_TRUE(std::any_of(structure.tables.fold.begin(), structure.tables.fold.end(),
                          [](double f) { return f != 0.0; }));
  const service::LawPacking packing(structure.tables);
  std::mt19937 random(3);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::VectorXd p = random_parameter(problem, random);
    const Eigen::VectorXd mirrored = -p;
    EXPECT_EQ(control::evaluate(packing.law(), p.data()).u,
              -control::evaluate(packing.law(), mirrored.data()).u);
  }
}

// The certificate asks every region on both sides of the fold.
TEST(LawSymmetry, AFoldThatWasTurnedIsNotProved) {
  const MpQp problem = benchmark_p5(10, 2.0);
  const OutputLaw output = first_input(problem, 4.0);
  const MpQpSolution solution = solve_mpqp(problem);
  std::vector<std::vector<int>> active_sets;
  for (const CriticalRegion& region : solution.regions) active_sets.push_back(region.active_set);
  service::LawTables tables = build_law_structure(solution, output).tables;
  ASSERT_TRUE(
      std::any_of(tables.fold.begin(), tables.fold.end(), [](double f) { return f != 0.0; }));
  const auto evaluated = [&] {
    return certify_law(problem, output, active_sets, &tables, {}).evaluated;
  };
  EXPECT_TRUE(evaluated());
  const std::vector<double> fold = tables.fold;
  for (double& f : tables.fold) f = -f;
  EXPECT_FALSE(evaluated());
  tables.fold = fold;
  std::swap(tables.fold[0], tables.fold[2]);
  EXPECT_FALSE(evaluated());
  tables.fold.assign(fold.size(), 0.0);
  EXPECT_FALSE(evaluated());
  // Its square vanishes; the evaluator would still fold.
  tables.fold[0] = 1e-170;
  EXPECT_THROW(evaluated(), std::invalid_argument);
}

}  // namespace
}  // namespace eampc::law_design
