#include "law_design/law_symmetry.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

#include "law_design/cell_geometry.hpp"
#include "law_design/linear_program.hpp"

namespace eampc::law_design {
namespace {

constexpr double kSameFacet = 1e-9;
constexpr double kSameRadius = 1e-9;
constexpr double kSameLaw = 2e-9;
// Hyperplanes of the partition tried as folds, besides the axes.
constexpr std::size_t kMostTried = 256;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

bool has_mirrored_facets(const HalfSpaces& a, const HalfSpaces& b) {
  if (a.size() != b.size()) return false;
  for (int i = 0; i < a.size(); ++i) {
    bool found = false;
    for (int k = 0; k < b.size() && !found; ++k) {
      double gap = std::abs(a.offset(i) - b.offset(k));
      for (int j = 0; j < a.dimension() && gap <= kSameFacet; ++j) {
        gap = std::max(gap, std::abs(a.normal(i, j) + b.normal(k, j)));
      }
      found = gap <= kSameFacet;
    }
    if (!found) return false;
  }
  return true;
}

bool has_mirrored_law(const LawPartition& partition, int a, int b) {
  if (partition.is_bound(a) || partition.is_bound(b)) {
    return (a == partition.low_law() && b == partition.high_law()) ||
           (a == partition.high_law() && b == partition.low_law());
  }
  const ScaledLaw& one = partition.laws[index(a)];
  const ScaledLaw& other = partition.laws[index(b)];
  double gap = std::abs(one[kMaxDimension] + other[kMaxDimension] - 1.0);
  for (std::size_t j = 0; j < kMaxDimension; ++j) gap += std::abs(one[j] - other[j]);
  return gap <= kSameLaw;
}

bool is_odd(const LawPartition& partition) {
  if (!partition.centre.isZero(0.0) || partition.y_min != -partition.y_max) return false;
  const std::vector<LawRegion>& regions = partition.regions;
  std::vector<std::size_t> by_radius(regions.size());
  std::iota(by_radius.begin(), by_radius.end(), std::size_t{0});
  std::sort(by_radius.begin(), by_radius.end(), [&](std::size_t a, std::size_t b) {
    return regions[a].radius != regions[b].radius ? regions[a].radius < regions[b].radius : a < b;
  });
  for (const LawRegion& region : regions) {
    const auto first =
        std::lower_bound(by_radius.begin(), by_radius.end(), region.radius - kSameRadius,
                         [&](std::size_t r, double radius) { return regions[r].radius < radius; });
    const bool found = std::any_of(
        first,
        std::find_if(
            first, by_radius.end(),
            [&](std::size_t r) { return regions[r].radius > region.radius + kSameRadius; }),
        [&](std::size_t r) {
          return has_mirrored_law(partition, region.law, regions[r].law) &&
                 has_mirrored_facets(region.facets, regions[r].facets);
        });
    if (!found) return false;
  }
  return true;
}

// Regions known to reach to both sides; those that are not saturated count most, they are divided.
int regions_cut(const LawPartition& partition, const Hyperplane& fold) {
  int count = 0;
  for (const LawRegion& region : partition.regions) {
    bool below = false;
    bool above = false;
    for (const Point& point : region.extent.points) {
      const double excess = fold.excess(point);
      below |= excess < -CellGeometry::kSide;
      above |= excess > CellGeometry::kSide;
    }
    if (below && above) count += partition.is_bound(region.law) ? 1 : 4;
  }
  return count;
}

// max ±fold over the region, from above.
double reach(const LawRegion& region, const Hyperplane& fold, double sign, LinearProgram& program) {
  Point c{};
  for (std::size_t j = 0; j < kMaxDimension; ++j) c[j] = sign * fold.normal[j];
  return program.maximise(c.data(), region.facets).value;
}

void cut_at(LawRegion& region, const Hyperplane& fold, LinearProgram& program,
            LinearProgram& ball) {
  const int np = region.facets.dimension();
  std::array<double, kMaxDimension + 1> side{};
  for (int j = 0; j < np; ++j) side[index(j)] = -fold.normal[index(j)];
  region.facets.append(side.data(), 0.0);
  side[index(np)] = 1.0;
  region.ball_facets.append(side.data(), 0.0);
  std::array<double, kMaxDimension + 1> radius{};
  radius[index(np)] = 1.0;
  const LpResult largest = ball.maximise(radius.data(), region.ball_facets);
  region.radius = largest.status == LpStatus::kOptimal ? largest.value : 0.0;
  if (largest.status == LpStatus::kOptimal) {
    std::copy_n(ball.point(), np, region.inside.begin());
  }
  region.extent.points.clear();
  for (int j = 0; j < np; ++j) {
    for (const double sign : {1.0, -1.0}) {
      Point c{};
      c[index(j)] = sign;
      const LpResult edge = program.maximise(c.data(), region.facets);
      if (edge.status != LpStatus::kOptimal) continue;
      (sign > 0.0 ? region.extent.upper : region.extent.lower)[index(j)] = sign * edge.value;
      Point point{};
      std::copy_n(program.point(), np, point.begin());
      region.extent.points.push_back(point);
    }
  }
}

}  // namespace

std::optional<Hyperplane> odd_symmetry(const LawPartition& partition) {
  if (!is_odd(partition)) return std::nullopt;
  std::vector<Hyperplane> tried;
  for (int j = 0; j < partition.parameters; ++j) {
    tried.emplace_back();
    tried.back().normal[index(j)] = 1.0;
  }
  const std::size_t step = partition.planes.size() / kMostTried + 1;
  for (std::size_t i = 0; i < partition.planes.size(); i += step) {
    tried.push_back({partition.planes[i].normal, 0.0});
  }
  const Hyperplane* best = nullptr;
  int least = 0;
  for (const Hyperplane& fold : tried) {
    const int cut = regions_cut(partition, fold);
    if (best != nullptr && cut >= least) continue;
    best = &fold;
    least = cut;
  }
  return *best;
}

LawPartition half_above(const LawPartition& partition, const Hyperplane& fold) {
  LawPartition half = partition;
  half.regions.clear();
  half.everywhere_feasible = false;  // nothing is asked of the cells below the fold
  LinearProgram program(partition.parameters);
  LinearProgram ball(partition.parameters + 1);
  ball.set_bounds(partition.parameters, -4.0, 2.0);
  ball.set_perturbation(1e-12);
  for (const LawRegion& region : partition.regions) {
    if (reach(region, fold, 1.0, program) <= CellGeometry::kSide) continue;
    half.regions.push_back(region);
    if (reach(region, fold, -1.0, program) > CellGeometry::kSide) {
      cut_at(half.regions.back(), fold, program, ball);
    }
  }
  return half;
}

Eigen::VectorXd fold_in_problem_units(const Hyperplane& fold, const LawPartition& partition) {
  const Eigen::Map<const Eigen::VectorXd> normal(fold.normal.data(), partition.parameters);
  return normal.cwiseQuotient(partition.half_width).normalized();
}

}  // namespace eampc::law_design
