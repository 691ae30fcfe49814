#include "law_design/region_polytope.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace eampc::law_design {
namespace {

constexpr double kClear = 1e-9;

enum : char { kOpen = 0, kFacet = 1, kRedundant = 2 };

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

RegionPolytopeMaker::RegionPolytopeMaker(int dimension)
    : dimension_(dimension), ball_(dimension), support_(dimension), rows_(dimension) {
  ball_.set_perturbation(1e-10);  // any centre nearly as good will do
}

// The row or side of the box (index rows_.size() + side) that a ray from the centre leaves by.
int RegionPolytopeMaker::first_hit(const Point& direction, double* distance, bool* clear) {
  double first = std::numeric_limits<double>::infinity();
  double second = first;
  int hit = -1;
  for (int i = 0; i < rows_.size(); ++i) {
    if (known_[index(i)] == kRedundant) continue;
    const double speed = rows_.product(i, direction.data());
    if (speed <= 1e-14) continue;
    const double t = slack_[index(i)] / speed;
    if (t < first) {
      second = first;
      first = t;
      hit = i;
    } else {
      second = std::min(second, t);
    }
  }
  *distance = first;
  *clear = second - first > kClear * first;
  return hit;
}

void RegionPolytopeMaker::accept(int row, const Point& point, RegionPolytope& result) {
  known_[index(row)] = kFacet;
  Point normal{};
  rows_.copy_normal(row, normal.data());
  result.facets.append(normal.data(), rows_.offset(row));
  result.labels.push_back(labels_[index(row)]);
  result.touched.push_back(point);
}

bool RegionPolytopeMaker::make(const HalfSpaces& rows, const std::vector<int>& labels,
                               double least_radius, RegionPolytope& result) {
  const int n = dimension_;
  result = RegionPolytope{};
  result.facets = HalfSpaces(n);
  rows_.clear();
  ball_.clear();
  labels_.clear();
  Point a{};
  for (int i = 0; i < rows.size(); ++i) {
    rows.copy_normal(i, a.data());
    double reach = 0.0;
    for (int j = 0; j < n; ++j) reach += std::abs(a[index(j)]);
    if (reach <= rows.offset(i)) continue;              // the box implies it
    if (-reach > rows.offset(i) + 1e-11) return false;  // no point of the box satisfies it
    rows_.append(a.data(), rows.offset(i));
    labels_.push_back(labels[index(i)]);
    ball_.append(a.data(), rows.offset(i));
  }
  const int own_rows = rows_.size();
  if (ball_.find().status != LpStatus::kOptimal) return false;
  result.radius = ball_.radius();
  std::copy_n(ball_.centre(), n, result.centre.begin());
  if (result.radius < least_radius) return false;
  const double cut = std::clamp(0.01 * result.radius, 2.0 * LinearProgram::kTolerance, kCut);

  slack_.resize(index(own_rows));
  known_.assign(index(own_rows), kOpen);
  for (int i = 0; i < own_rows; ++i) {
    slack_[index(i)] = std::max(rows_.offset(i) - rows_.product(i, result.centre.data()), 0.0);
  }
  Point direction{};
  const auto point_at = [&](double t) {
    Point p{};
    for (int j = 0; j < n; ++j) {
      p[index(j)] = std::clamp(result.centre[index(j)] + t * direction[index(j)], -1.0, 1.0);
    }
    return p;
  };
  const auto box_distance = [&] {
    double t = std::numeric_limits<double>::infinity();
    for (int j = 0; j < n; ++j) {
      const double d = direction[index(j)];
      if (d != 0.0) t = std::min(t, ((d > 0.0 ? 1.0 : -1.0) - result.centre[index(j)]) / d);
    }
    return t;
  };
  double distance = 0.0;
  bool clear = false;
  // Rays along the normals name most facets without a linear program.
  for (int i = 0; i < own_rows; ++i) {
    rows_.copy_normal(i, direction.data());
    const int hit = first_hit(direction, &distance, &clear);
    if (hit < 0 || !clear || known_[index(hit)] == kFacet || distance >= box_distance()) continue;
    accept(hit, point_at(distance), result);
  }
  // The others: redundant by a linear program over the facets found so far, or what the program
  // finds beyond them leads, by a ray, to one more facet.
  for (int i = 0; i < own_rows; ++i) {
    while (known_[index(i)] == kOpen) {
      Point normal{};
      rows_.copy_normal(i, normal.data());
      const double limit = rows_.offset(i) + cut;
      const LpResult support = support_.maximise(normal.data(), result.facets, limit);
      if (support.status == LpStatus::kBelowCutoff ||
          (support.status == LpStatus::kOptimal && support.value <= limit)) {
        known_[index(i)] = kRedundant;
        break;
      }
      int hit = i;
      distance = 1.0;
      if (support.status == LpStatus::kOptimal) {
        for (int j = 0; j < n; ++j) {
          direction[index(j)] = support_.point()[j] - result.centre[index(j)];
        }
        hit = first_hit(direction, &distance, &clear);
      }
      // Keeping a row is always right.
      if (hit < 0 || known_[index(hit)] != kOpen) hit = i;
      accept(hit, point_at(std::min(distance, 1.0)), result);
    }
  }
  return true;
}

}  // namespace eampc::law_design
