#include "law_design/polytope.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace eampc::law_design {
namespace {

// A row that cuts off less than this beyond the other rows is redundant; in a thin polytope, whose
// nearly parallel planes meet far away, a hundredth of its radius, as far as rounding allows.
constexpr double kCut = 1e-10;
constexpr double kLeastCut = 2e-12;
constexpr double kClear = 1e-9;

enum : char { kUnknown = 0, kFacet = 1, kRedundant = 2 };

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

PolytopeReducer::PolytopeReducer(int dimension)
    : dimension_(dimension),
      ball_(dimension + 1),
      support_(dimension),
      ball_rows_(dimension + 1),
      rows_(dimension),
      found_(dimension) {
  ball_.set_bounds(dimension, -4.0, 2.0);
  ball_.set_perturbation(1e-9);  // any centre nearly as good will do
}

PolytopeReducer::Hit PolytopeReducer::shoot(const double* direction) {
  const int m = rows_.size();
  for (int i = 0; i < m; ++i) speed_[index(i)] = 0.0;
  for (int j = 0; j < dimension_; ++j) {
    const double* column = rows_.column(j);
    const double d = direction[j];
    for (int i = 0; i < m; ++i) speed_[index(i)] += column[i] * d;
  }
  Hit hit;
  double first = std::numeric_limits<double>::infinity();
  double second = first;
  for (int i = 0; i < m; ++i) {
    if (speed_[index(i)] <= 1e-14 || state_[index(i)] == kRedundant) continue;
    const double t = slack_[index(i)] / speed_[index(i)];
    if (t < first) {
      second = first;
      first = t;
      hit.row = i;
    } else if (t < second) {
      second = t;
    }
  }
  hit.distance = first;
  hit.clear = second - first > kClear;
  return hit;
}

void PolytopeReducer::accept(int row, const Point& on_facet, bool clear, Polytope& result) {
  if (!clear) doubtful_.push_back(result.facets.size());
  state_[index(row)] = kFacet;
  Point normal{};
  rows_.copy_normal(row, normal.data());
  result.facets.append(normal.data(), rows_.offset(row));
  result.labels.push_back(labels_[index(row)]);
  result.facet_points.push_back(on_facet);
  if (labels_[index(row)] != kBoxLabel) found_.append(normal.data(), rows_.offset(row));
}

// A ray to a vertex hits several rows at once, some of which may only touch the polytope there.
// Called while `found_` holds exactly the facets of `result`.
void PolytopeReducer::drop_redundant(Polytope& result) {
  std::vector<char> dropped(index(result.facets.size()), 0);
  bool any = false;
  Point normal{};
  for (const int f : doubtful_) {
    result.facets.copy_normal(f, normal.data());
    const double offset = result.facets.offset(f);
    found_.set_offset(f, 1e30);
    const LpResult support = support_.maximise(normal.data(), found_, offset + cut_);
    if (support.status == LpStatus::kBelowCutoff ||
        (support.status == LpStatus::kOptimal && support.value <= offset + cut_)) {
      dropped[index(f)] = 1;
      any = true;
    } else {
      found_.set_offset(f, offset);
    }
  }
  if (!any) return;
  Polytope kept;
  kept.facets = HalfSpaces(dimension_);
  found_.clear();
  for (int f = 0; f < result.facets.size(); ++f) {
    if (dropped[index(f)] != 0) continue;
    result.facets.copy_normal(f, normal.data());
    kept.facets.append(normal.data(), result.facets.offset(f));
    found_.append(normal.data(), result.facets.offset(f));
    kept.labels.push_back(result.labels[index(f)]);
    kept.facet_points.push_back(result.facet_points[index(f)]);
  }
  result.facets = std::move(kept.facets);
  result.labels = std::move(kept.labels);
  result.facet_points = std::move(kept.facet_points);
}

bool PolytopeReducer::holds_ball(const HalfSpaces& rows, const std::vector<int>& labels,
                                 double least_radius) {
  const int n = dimension_;
  rows_.clear();
  labels_.clear();
  ball_rows_.clear();
  std::array<double, kMaxDimension + 1> a{};
  for (int i = 0; i < rows.size(); ++i) {
    rows.copy_normal(i, a.data());
    double reach = 0.0;
    for (int j = 0; j < n; ++j) reach += std::abs(a[index(j)]);
    if (reach <= rows.offset(i) + 1e-12) continue;  // the box implies it
    if (-reach > rows.offset(i)) return false;      // no point of the box satisfies it
    rows_.append(a.data(), rows.offset(i));
    labels_.push_back(labels[index(i)]);
    a[index(n)] = 1.0;
    ball_rows_.append(a.data(), rows.offset(i));
  }
  own_rows_ = rows_.size();
  for (int j = 0; j < 2 * n; ++j) {
    a.fill(0.0);
    a[index(j / 2)] = j % 2 == 0 ? 1.0 : -1.0;
    rows_.append(a.data(), 1.0);
    labels_.push_back(kBoxLabel);
    a[index(n)] = 1.0;
    ball_rows_.append(a.data(), 1.0);
  }
  a.fill(0.0);
  a[index(n)] = 1.0;
  const LpResult ball = ball_.maximise(a.data(), ball_rows_, least_radius);
  return ball.status == LpStatus::kOptimal && ball_.point()[n] >= least_radius;
}

bool PolytopeReducer::reduce(const HalfSpaces& rows, const std::vector<int>& labels,
                             double least_radius, Polytope& result) {
  if (!holds_ball(rows, labels, least_radius)) return false;
  const int n = dimension_;
  const int own_rows = own_rows_;
  doubtful_.clear();
  result = Polytope{};
  result.facets = HalfSpaces(n);
  result.radius = ball_.point()[n];
  cut_ = std::clamp(0.01 * result.radius, kLeastCut, kCut);
  support_.set_tolerance(0.1 * cut_);
  for (int j = 0; j < n; ++j) result.centre[index(j)] = ball_.point()[j];

  const int m = rows_.size();
  slack_.resize(index(m));
  speed_.resize(index(m));
  state_.assign(index(m), kUnknown);
  found_.clear();
  rows_.excess(result.centre.data(), slack_.data());
  for (int i = 0; i < m; ++i) slack_[index(i)] = -slack_[index(i)];

  // Rays along every normal name most facets without a linear program.
  Point direction{};
  const auto point_at = [&](double t) {
    Point p{};
    for (int j = 0; j < n; ++j) {
      p[index(j)] = result.centre[index(j)] + t * direction[index(j)];
    }
    return p;
  };
  for (int i = 0; i < own_rows; ++i) {
    if (state_[index(i)] == kFacet) continue;
    rows_.copy_normal(i, direction.data());
    const Hit hit = shoot(direction.data());
    if (!hit.clear || state_[index(hit.row)] == kFacet || labels_[index(hit.row)] == kBoxLabel) {
      continue;
    }
    accept(hit.row, point_at(hit.distance), true, result);
  }
  // Clarkson: test each remaining row against the facets found so far; a row that still cuts
  // something off leads, by a ray to what it cuts off, to a facet (itself or another).
  for (int i = 0; i < own_rows; ++i) {
    while (state_[index(i)] == kUnknown) {
      Point normal{};
      rows_.copy_normal(i, normal.data());
      const double offset = rows_.offset(i);
      const LpResult support = support_.maximise(normal.data(), found_, offset + cut_);
      if (support.status == LpStatus::kBelowCutoff ||
          (support.status == LpStatus::kOptimal && support.value <= offset + cut_)) {
        state_[index(i)] = kRedundant;
        break;
      }
      for (int j = 0; j < n; ++j) {
        direction[index(j)] = support_.point()[j] - result.centre[index(j)];
      }
      const Hit hit = shoot(direction.data());
      if (support.status == LpStatus::kOptimal && hit.row >= 0 &&
          state_[index(hit.row)] == kUnknown && labels_[index(hit.row)] != kBoxLabel) {
        accept(hit.row, point_at(hit.distance), hit.clear, result);
      } else {
        // Not decidable: keeping a row is always right.
        double t = 1.0;
        double speed = 0.0;
        for (int j = 0; j < n; ++j) speed += normal[index(j)] * direction[index(j)];
        if (speed > 1e-14) t = std::min(1.0, slack_[index(i)] / speed);
        accept(i, point_at(t), false, result);
      }
    }
  }
  drop_redundant(result);
  // Facets of the box, by the same test.
  for (int i = own_rows; i < m; ++i) {
    Point normal{};
    rows_.copy_normal(i, normal.data());
    const LpResult support = support_.maximise(normal.data(), found_, 1.0 - cut_);
    if (support.status != LpStatus::kOptimal || support.value <= 1.0 - cut_) continue;
    Point on_facet{};
    for (int j = 0; j < n; ++j) on_facet[index(j)] = support_.point()[j];
    accept(i, on_facet, true, result);
  }
  return true;
}

}  // namespace eampc::law_design
