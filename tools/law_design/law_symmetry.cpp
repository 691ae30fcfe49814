#include "law_design/law_symmetry.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

#include "law_design/cell_geometry.hpp"
#include "law_design/linear_program.hpp"

namespace eampc::law_design {
namespace {

constexpr double kSameFacet = 1e-9;
constexpr double kSameRadius = 1e-9;
constexpr double kSameLaw = 2e-9;
constexpr double kSameValue = 1e-7;  // of the output's range, at one point
// Share of the regions that may lack a mirror image.
constexpr double kMostAlone = 0.01;
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

struct Alone {
  std::size_t region = 0;
  int law = 0;  // of its mirror image
};

double clipped(const LawPartition& partition, int law, const Point& q) {
  return std::clamp(partition.value(law, q.data()), 0.0, 1.0);
}

// The law of the mirror image of a region that has none among the regions, if the law is odd there:
// ties between active sets may be broken differently on both sides. Else -1.
int mirrored_law(const LawPartition& partition, const LawRegion& region) {
  Point opposite = region.inside;
  for (double& x : opposite) x = -x;
  const double value = 1.0 - clipped(partition, region.law, region.inside);
  const bool odd =
      std::any_of(partition.regions.begin(), partition.regions.end(), [&](const LawRegion& other) {
        return other.facets.contains(opposite.data(), kSameFacet) &&
               std::abs(clipped(partition, other.law, opposite) - value) <= kSameValue;
      });
  for (int law = 0; odd && law <= partition.high_law(); ++law) {
    if (has_mirrored_law(partition, region.law, law)) return law;
  }
  return -1;
}

// Regions without a mirror image among the regions; nothing if the law is not odd.
std::optional<std::vector<Alone>> find_alone(const LawPartition& partition) {
  if (!partition.centre.isZero(0.0) || partition.y_min != -partition.y_max) return std::nullopt;
  const std::vector<LawRegion>& regions = partition.regions;
  const auto most = static_cast<std::size_t>(kMostAlone * static_cast<double>(regions.size()));
  std::vector<std::size_t> by_radius(regions.size());
  std::iota(by_radius.begin(), by_radius.end(), std::size_t{0});
  std::sort(by_radius.begin(), by_radius.end(), [&](std::size_t a, std::size_t b) {
    return regions[a].radius != regions[b].radius ? regions[a].radius < regions[b].radius : a < b;
  });
  std::vector<Alone> alone;
  for (std::size_t own = 0; own < regions.size(); ++own) {
    const LawRegion& region = regions[own];
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
    if (found) continue;
    if (alone.size() == most) return std::nullopt;
    const int law = mirrored_law(partition, region);
    if (law < 0) return std::nullopt;
    alone.push_back({own, law});
  }
  return alone;
}

HalfSpaces mirror_image(const HalfSpaces& rows, int parameters) {
  HalfSpaces image(rows.dimension());
  std::array<double, kMaxDimension + 1> a{};
  for (int i = 0; i < rows.size(); ++i) {
    rows.copy_normal(i, a.data());
    for (int j = 0; j < parameters; ++j) a[index(j)] = -a[index(j)];
    image.append(a.data(), rows.offset(i));
  }
  return image;
}

LawRegion mirror_image(const LawRegion& region, int law, int parameters) {
  LawRegion image = region;
  image.facets = mirror_image(region.facets, parameters);
  image.ball_facets = mirror_image(region.ball_facets, parameters);
  image.planes.clear();
  image.law = law;
  const auto turn = [](Point& q) {
    for (double& x : q) x = -x;
  };
  turn(image.inside);
  std::swap(image.extent.lower, image.extent.upper);
  turn(image.extent.lower);
  turn(image.extent.upper);
  std::for_each(image.extent.points.begin(), image.extent.points.end(), turn);
  return image;
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
  if (!find_alone(partition)) return std::nullopt;
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
  const auto keep = [&](const LawRegion& region) {
    if (reach(region, fold, 1.0, program) <= CellGeometry::kSide) return;
    half.regions.push_back(region);
    if (reach(region, fold, -1.0, program) > CellGeometry::kSide) {
      cut_at(half.regions.back(), fold, program, ball);
    }
  };
  std::for_each(partition.regions.begin(), partition.regions.end(), keep);
  if (const auto alone = find_alone(partition)) {
    for (const Alone& region : *alone) {
      keep(mirror_image(partition.regions[region.region], region.law, partition.parameters));
    }
  }
  return half;
}

Eigen::VectorXd fold_in_problem_units(const Hyperplane& fold, const LawPartition& partition) {
  const Eigen::Map<const Eigen::VectorXd> normal(fold.normal.data(), partition.parameters);
  return normal.cwiseQuotient(partition.half_width).normalized();
}

}  // namespace eampc::law_design
