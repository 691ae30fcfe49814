#include "law_design/law_partition.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <unordered_map>

#include "law_design/linear_program.hpp"

namespace eampc::law_design {
namespace {

// Of the output's range, which is 1 here.
constexpr double kSameLaw = 1e-9;
constexpr double kSaturated = 1e-9;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

ScaledLaw scaled_law(const CriticalRegion& region, const OutputLaw& output,
                     const LawPartition& partition) {
  const double range = output.y_max - output.y_min;
  const Eigen::RowVectorXd slope = output.Y_U * region.gain + output.Y_p;
  double middle = output.Y_U.dot(region.offset) + output.y_0;
  ScaledLaw law{};
  for (int j = 0; j < partition.parameters; ++j) {
    law[index(j)] = slope(j) * partition.half_width(j) / range;
    middle += slope(j) * partition.centre(j);
  }
  law[kMaxDimension] = (middle - output.y_min) / range;
  return law;
}

double difference(const ScaledLaw& a, const ScaledLaw& b) {
  double sum = 0.0;
  for (std::size_t j = 0; j < a.size(); ++j) sum += std::abs(a[j] - b[j]);
  return sum;
}

// Groups laws that agree over the whole box; returns the group of each.
std::vector<int> group(const std::vector<ScaledLaw>& all, std::vector<ScaledLaw>& distinct) {
  std::vector<int> order(all.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    const ScaledLaw& x = all[index(a)];
    const ScaledLaw& y = all[index(b)];
    if (x[kMaxDimension] != y[kMaxDimension]) return x[kMaxDimension] < y[kMaxDimension];
    return x != y ? x < y : a < b;
  });
  std::vector<int> groups(all.size(), -1);
  std::vector<int> representatives;  // members of `order`, ascending offset
  for (const int i : order) {
    for (auto r = representatives.rbegin(); r != representatives.rend(); ++r) {
      const ScaledLaw& other = all[index(*r)];
      if (all[index(i)][kMaxDimension] - other[kMaxDimension] > kSameLaw) break;
      if (difference(all[index(i)], other) <= kSameLaw) {
        groups[index(i)] = groups[index(*r)];
        break;
      }
    }
    if (groups[index(i)] < 0) {
      groups[index(i)] = static_cast<int>(distinct.size());
      distinct.push_back(all[index(i)]);
      representatives.push_back(i);
    }
  }
  return groups;
}

enum class Saturation { kNone, kLow, kHigh };

Saturation saturation(const ScaledLaw& law, const HalfSpaces& facets, LinearProgram& program) {
  Point c{};
  std::copy(law.begin(), law.begin() + kMaxDimension, c.begin());
  const auto at_most = [&](double bound) {
    double reach = 0.0;
    for (const double slope : c) reach += std::abs(slope);
    if (reach <= bound) return true;
    const LpResult result = program.maximise(c.data(), facets, bound);
    return result.status == LpStatus::kBelowCutoff ||
           (result.status == LpStatus::kOptimal && result.value <= bound);
  };
  if (at_most(kSaturated - law[kMaxDimension])) return Saturation::kLow;
  for (double& slope : c) slope = -slope;
  if (at_most(law[kMaxDimension] - 1.0 + kSaturated)) return Saturation::kHigh;
  return Saturation::kNone;
}

LawRegion scaled_region(const CriticalRegion& region, const LawPartition& partition,
                        LinearProgram& program) {
  const int np = partition.parameters;
  LawRegion scaled;
  scaled.facets = HalfSpaces(np);
  scaled.ball_facets = HalfSpaces(np + 1);
  for (Eigen::Index i = 0; i < region.facet_normals.rows(); ++i) {
    Eigen::VectorXd a = region.facet_normals.row(i).transpose().cwiseProduct(partition.half_width);
    double b = region.facet_offsets(i) - region.facet_normals.row(i).dot(partition.centre);
    const double norm = a.norm();
    a /= norm;
    b /= norm;
    scaled.facets.append(a.data(), b);
    std::array<double, kMaxDimension + 1> ball{};
    std::copy(a.data(), a.data() + np, ball.begin());
    ball[index(np)] = 1.0;
    scaled.ball_facets.append(ball.data(), b);
  }
  scaled.radius = region.radius;
  for (int j = 0; j < np; ++j) {
    scaled.inside[index(j)] = (region.interior(j) - partition.centre(j)) / partition.half_width(j);
    scaled.extent.lower[index(j)] = -1.0;
    scaled.extent.upper[index(j)] = 1.0;
    for (const double sign : {1.0, -1.0}) {
      Point c{};
      c[index(j)] = sign;
      const LpResult edge = program.maximise(c.data(), scaled.facets);
      if (edge.status != LpStatus::kOptimal) continue;
      (sign > 0.0 ? scaled.extent.upper : scaled.extent.lower)[index(j)] = sign * edge.value;
      Point point{};
      std::copy(program.point(), program.point() + np, point.begin());
      scaled.extent.points.push_back(point);
    }
  }
  return scaled;
}

/// Hyperplanes by value, with a sign of their own.
class PlaneTable {
 public:
  explicit PlaneTable(std::vector<Hyperplane>& planes) : planes_(planes) {}

  int id_of(Hyperplane plane) {
    for (const double a : plane.normal) {
      if (std::abs(a) < 1e-6) continue;
      if (a < 0.0) {
        for (double& x : plane.normal) x = -x;
        plane.offset = -plane.offset;
      }
      break;
    }
    std::size_t key = 1469598103934665603U;
    const auto mix = [&](double x) {
      key ^= static_cast<std::size_t>(static_cast<std::int64_t>(std::llround(x * 1e7)));
      key *= 1099511628211U;
    };
    for (const double a : plane.normal) mix(a);
    mix(plane.offset);
    std::vector<int>& bucket = buckets_[key];
    for (const int other : bucket) {
      double gap = std::abs(planes_[index(other)].offset - plane.offset);
      for (std::size_t j = 0; j < plane.normal.size(); ++j) {
        gap += std::abs(planes_[index(other)].normal[j] - plane.normal[j]);
      }
      if (gap < 1e-10) return other;
    }
    bucket.push_back(static_cast<int>(planes_.size()));
    planes_.push_back(plane);
    return bucket.back();
  }

 private:
  std::vector<Hyperplane>& planes_;
  std::unordered_map<std::size_t, std::vector<int>> buckets_;
};

void collect_planes(const MpQpSolution& solution, LawPartition& partition) {
  PlaneTable table(partition.planes);
  for (std::size_t r = 0; r < partition.regions.size(); ++r) {
    LawRegion& region = partition.regions[r];
    const auto& neighbours = solution.regions[r].neighbours;
    for (std::size_t f = 0; f < neighbours.size(); ++f) {
      const bool same = !neighbours[f].empty() &&
                        std::all_of(neighbours[f].begin(), neighbours[f].end(), [&](int other) {
                          return partition.regions[index(other)].law == region.law;
                        });
      const bool on_box = neighbours[f].empty() && partition.everywhere_feasible;
      if (same || on_box) continue;
      Hyperplane plane;
      region.facets.copy_normal(static_cast<int>(f), plane.normal.data());
      plane.offset = region.facets.offset(static_cast<int>(f));
      region.planes.push_back(table.id_of(plane));
    }
  }
}

}  // namespace

LawPartition partition_by_law(const MpQpSolution& solution, const OutputLaw& output) {
  const Eigen::Index np = solution.lower.size();
  if (solution.regions.empty()) throw std::invalid_argument("law partition: no critical region");
  if (output.Y_U.size() != solution.regions.front().offset.size() || output.Y_p.size() != np) {
    throw std::invalid_argument("law partition: Y_U needs n entries and Y_p needs np");
  }
  if (!(output.y_min < output.y_max) || !std::isfinite(output.y_max - output.y_min)) {
    throw std::invalid_argument("law partition: y_min and y_max must be finite, y_min < y_max");
  }
  LawPartition result;
  result.parameters = static_cast<int>(np);
  result.centre = 0.5 * (solution.lower + solution.upper);
  result.half_width = 0.5 * (solution.upper - solution.lower);
  result.y_min = output.y_min;
  result.y_max = output.y_max;
  result.everywhere_feasible = !solution.has_infeasible_parameters;

  LinearProgram program(result.parameters);
  std::vector<ScaledLaw> unsaturated;
  std::vector<Saturation> saturations;
  for (const CriticalRegion& region : solution.regions) {
    result.regions.push_back(scaled_region(region, result, program));
    const ScaledLaw law = scaled_law(region, output, result);
    saturations.push_back(saturation(law, result.regions.back().facets, program));
    if (saturations.back() == Saturation::kNone) unsaturated.push_back(law);
  }
  result.unsaturated_regions = static_cast<int>(unsaturated.size());
  const std::vector<int> groups = group(unsaturated, result.laws);
  result.laws.push_back(ScaledLaw{});
  result.laws.push_back(ScaledLaw{});
  result.laws.back()[kMaxDimension] = 1.0;
  std::size_t next = 0;
  for (std::size_t r = 0; r < result.regions.size(); ++r) {
    switch (saturations[r]) {
      case Saturation::kNone:
        result.regions[r].law = groups[next++];
        break;
      case Saturation::kLow:
        result.regions[r].law = result.low_law();
        break;
      case Saturation::kHigh:
        result.regions[r].law = result.high_law();
        break;
    }
  }
  collect_planes(solution, result);
  return result;
}

Eigen::VectorXd in_problem_units(const Hyperplane& plane, const LawPartition& partition) {
  const Eigen::Index np = partition.parameters;
  const Eigen::Map<const Eigen::VectorXd> normal(plane.normal.data(), np);
  Eigen::VectorXd result(np + 1);
  result.head(np) = normal.cwiseQuotient(partition.half_width);
  const double norm = result.head(np).norm();
  result.head(np) /= norm;
  result(np) = plane.offset / norm + result.head(np).dot(partition.centre);
  return result;
}

Eigen::VectorXd in_problem_units(const ScaledLaw& law, const LawPartition& partition) {
  const Eigen::Index np = partition.parameters;
  const double range = partition.y_max - partition.y_min;
  const Eigen::Map<const Eigen::VectorXd> slope(law.data(), np);
  Eigen::VectorXd result(np + 1);
  result.head(np) = range * slope.cwiseQuotient(partition.half_width);
  result(np) = partition.y_min + range * law[kMaxDimension] - result.head(np).dot(partition.centre);
  return result;
}

}  // namespace eampc::law_design
