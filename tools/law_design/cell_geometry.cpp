#include "law_design/cell_geometry.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace eampc::law_design {
namespace {

// A cell without a ball of this radius is the rounding of two nearly equal hyperplanes.
constexpr double kThinCell = 1e-9;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

void Cell::push(const Hyperplane& plane, bool above) {
  const double sign = above ? -1.0 : 1.0;
  std::array<double, kMaxDimension + 1> a{};
  for (int j = 0; j < dimension_; ++j) a[index(j)] = sign * plane.normal[index(j)];
  rows_.append(a.data(), sign * plane.offset);
  a[index(dimension_)] = 1.0;
  ball_.append(a.data(), sign * plane.offset);
}

void Cell::pop() {
  rows_.pop();
  ball_.pop();
}

CellGeometry::CellGeometry(const LawPartition& partition)
    : partition_(partition),
      dimension_(partition.parameters),
      program_(partition.parameters),
      ball_(partition.parameters + 1),
      extra_(partition.parameters) {
  ball_.set_bounds(dimension_, -4.0, 2.0);
  ball_.set_perturbation(1e-12);
}

CellGeometry::Presence CellGeometry::presence(const Cell& cell, CellItem& item) {
  std::array<double, kMaxDimension + 1> c{};
  c[index(dimension_)] = 1.0;
  const LawRegion& region = partition_.regions[index(item.region)];
  const HalfSpaces* parts[] = {&region.ball_facets, &cell.ball_rows()};
  const LpResult ball = ball_.maximise(c.data(), parts, kTouch);
  if (ball.status == LpStatus::kFailed) {
    item.radius = 0.0;
    return Presence::kThin;
  }
  if (ball.status != LpStatus::kOptimal || ball_.point()[dimension_] <= kTouch) {
    return Presence::kAbsent;
  }
  item.radius = ball_.point()[dimension_];
  std::copy(ball_.point(), ball_.point() + dimension_, item.inside.begin());
  return item.radius > kThin ? Presence::kThere : Presence::kThin;
}

void CellGeometry::refresh_extent(const Cell& cell, CellItem& item) {
  const LawRegion& region = partition_.regions[index(item.region)];
  const HalfSpaces* parts[] = {&region.facets, &cell.rows()};
  std::vector<Point> known;
  known.reserve(2 * index(dimension_));
  known.swap(item.extent.points);
  for (int j = 0; j < dimension_; ++j) {
    for (const double sign : {1.0, -1.0}) {
      double& bound = (sign > 0.0 ? item.extent.upper : item.extent.lower)[index(j)];
      // A bound that a known point attains is the bound of this part too.
      const auto attains = [&](const Point& q) {
        return std::abs(q[index(j)] - bound) <= LinearProgram::kTolerance;
      };
      const auto extreme = std::find_if(known.begin(), known.end(), attains);
      if (extreme != known.end()) {
        item.extent.points.push_back(*extreme);
        continue;
      }
      Point c{};
      c[index(j)] = sign;
      const LpResult edge = program_.maximise(c.data(), parts);
      if (edge.status != LpStatus::kOptimal) continue;
      bound = sign * edge.value;
      Point point{};
      std::copy(program_.point(), program_.point() + dimension_, point.begin());
      item.extent.points.push_back(point);
    }
  }
}

bool CellGeometry::difference_below(int law_a, int law_b, const CellItem& item, const Cell& cell,
                                    double bound) {
  const ScaledLaw& a = partition_.laws[index(law_a)];
  const ScaledLaw& b = partition_.laws[index(law_b)];
  Point c{};
  for (std::size_t j = 0; j < c.size(); ++j) c[j] = a[j] - b[j];
  const double limit = bound - (a[kMaxDimension] - b[kMaxDimension]);
  double reach = 0.0;
  for (std::size_t j = 0; j < index(dimension_); ++j) {
    reach += c[j] * (c[j] > 0.0 ? item.extent.upper[j] : item.extent.lower[j]);
  }
  if (reach <= limit) return true;
  const auto beyond = [&](const Point& q) {
    double sum = -limit;
    for (std::size_t j = 0; j < index(dimension_); ++j) sum += c[j] * q[j];
    return sum > 1e-9;
  };
  if (item.radius > 0.0 && beyond(item.inside)) return false;
  if (std::any_of(item.extent.points.begin(), item.extent.points.end(), beyond)) return false;
  const HalfSpaces* parts[] = {&partition_.regions[index(item.region)].facets, &cell.rows()};
  const LpResult result = program_.maximise(c.data(), parts, limit);
  return result.status == LpStatus::kBelowCutoff || result.status == LpStatus::kInfeasible ||
         (result.status == LpStatus::kOptimal && result.value <= limit);
}

// Adds the row sign·law(q) ≤ bound.
void CellGeometry::require_at_most(const ScaledLaw& law, double sign, double bound) {
  Point a{};
  double norm = 0.0;
  for (std::size_t j = 0; j < index(dimension_); ++j) {
    a[j] = sign * law[j];
    norm += a[j] * a[j];
  }
  norm = std::sqrt(norm);
  double b = bound - sign * law[kMaxDimension];
  if (norm < 1e-12) {
    // Constant: all of the cell, or none.
    a[0] = 1.0;
    b = b >= 0.0 ? 3.0 : -3.0;
    norm = 1.0;
  }
  for (double& x : a) x /= norm;
  extra_.append(a.data(), b / norm);
}

bool CellGeometry::clipped_difference_below(int law_a, int law_b, const CellItem& item,
                                            const Cell& cell, double bound) {
  if (difference_below(law_a, law_b, item, cell, bound)) return true;
  const LawRegion& region = partition_.regions[index(item.region)];
  extra_.clear();
  const ScaledLaw& own = partition_.laws[index(region.law)];
  if (region.law == law_b) {
    require_at_most(own, 1.0, 1.0 - bound);
  } else {
    require_at_most(own, -1.0, -bound);
  }
  const ScaledLaw& a = partition_.laws[index(law_a)];
  const ScaledLaw& b = partition_.laws[index(law_b)];
  Point c{};
  for (std::size_t j = 0; j < c.size(); ++j) c[j] = a[j] - b[j];
  const double limit = bound - (a[kMaxDimension] - b[kMaxDimension]);
  const HalfSpaces* parts[] = {&region.facets, &cell.rows(), &extra_};
  const LpResult result = program_.maximise(c.data(), parts, limit);
  return result.status == LpStatus::kBelowCutoff || result.status == LpStatus::kInfeasible ||
         (result.status == LpStatus::kOptimal && result.value <= limit);
}

bool CellGeometry::none_above(const std::vector<int>& laws, const CellItem& item, const Cell& cell,
                              double bound) {
  const LawRegion& region = partition_.regions[index(item.region)];
  const ScaledLaw& own = partition_.laws[index(region.law)];
  extra_.clear();
  require_at_most(own, 1.0, 1.0 - bound);
  Point c{};
  for (const int other : laws) {
    ScaledLaw gap = own;
    const ScaledLaw& l = partition_.laws[index(other)];
    for (std::size_t j = 0; j < gap.size(); ++j) gap[j] -= l[j];
    require_at_most(gap, 1.0, -bound);
    for (std::size_t j = 0; j < index(dimension_); ++j) c[j] -= gap[j];
  }
  const HalfSpaces* parts[] = {&region.facets, &cell.rows(), &extra_};
  return program_.maximise(c.data(), parts).status == LpStatus::kInfeasible;
}

// Where no term reaches the top, each has a law below it: every choice of one law per term must be
// impossible. Most are after the first few terms.
bool CellGeometry::reach_top_from(const std::vector<std::vector<int>>& terms, std::size_t first,
                                  const CellItem& item, const Cell& cell, double bound,
                                  int* budget) {
  if (first > 0) {
    if (--*budget < 0) return false;
    Point c{};
    for (int row = 0; row < extra_.size(); ++row) {
      for (int j = 0; j < dimension_; ++j) c[index(j)] -= extra_.normal(row, j);
    }
    const HalfSpaces* parts[] = {&partition_.regions[index(item.region)].facets, &cell.rows(),
                                 &extra_};
    if (program_.maximise(c.data(), parts).status == LpStatus::kInfeasible) return true;
  }
  if (first == terms.size()) return false;
  for (const int law : terms[first]) {
    require_at_most(partition_.laws[index(law)], 1.0, 1.0 - bound);
    const bool impossible = reach_top_from(terms, first + 1, item, cell, bound, budget);
    extra_.pop();
    if (!impossible) return false;
  }
  return true;
}

bool CellGeometry::some_reach_top(const std::vector<std::vector<int>>& terms, const CellItem& item,
                                  const Cell& cell, double bound) {
  extra_.clear();
  int budget = 100;
  return reach_top_from(terms, 0, item, cell, bound, &budget);
}

bool CellGeometry::centre(const Cell& cell, Point* centre) {
  std::array<double, kMaxDimension + 1> c{};
  c[index(dimension_)] = 1.0;
  HalfSpaces box(dimension_ + 1);
  for (int j = 0; j < 2 * dimension_; ++j) {
    std::array<double, kMaxDimension + 1> a{};
    a[index(j / 2)] = j % 2 == 0 ? 1.0 : -1.0;
    a[index(dimension_)] = 1.0;
    box.append(a.data(), 1.0);
  }
  const HalfSpaces* parts[] = {&cell.ball_rows(), &box};
  const LpResult result = ball_.maximise(c.data(), parts, kThinCell);
  if (result.status != LpStatus::kOptimal) return false;
  std::copy(ball_.point(), ball_.point() + dimension_, centre->begin());
  return true;
}

}  // namespace eampc::law_design
