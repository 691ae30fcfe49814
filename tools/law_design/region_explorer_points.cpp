// What RegionExplorer asks of single parameters: where to start, and whether seeded random ones lie
// in the regions found.
#include <algorithm>
#include <random>

#include "law_design/region_explorer.hpp"

namespace eampc::law_design {
namespace {

constexpr double kInside = 1e-9;  // in q; as in region_explorer.cpp

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

QpStatus RegionExplorer::solve_at(const Point& q, double nudge, std::vector<int>& active) {
  form_.right_side(q.data(), right_side_.data());
  for (int i = 0; i < static_cast<int>(form_.rows.rows()); ++i) {
    right_side_[index(i)] += nudge * builders_.front()->nudge(i);
  }
  QpStatus status = program_.solve(right_side_.data(), active);
  if (status == QpStatus::kFailed && !active.empty()) {
    active.clear();
    status = program_.solve(right_side_.data(), active);
  }
  return status;
}

void RegionExplorer::find_first_region() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Point> points;
  for (const Eigen::VectorXd& q : form_.feasible_points) {
    points.emplace_back();
    std::copy(q.data(), q.data() + form_.parameters, points.back().begin());
  }
  // Small steps away from the feasible ones: their own active set may be flat.
  for (std::size_t i = 0; i < 100 && !form_.feasible_points.empty(); ++i) {
    Point q = points[i % form_.feasible_points.size()];
    for (int j = 0; j < form_.parameters; ++j) {
      q[index(j)] = std::clamp(q[index(j)] + 1e-3 * uniform(random), -1.0, 1.0);
    }
    points.push_back(q);
  }
  for (const double nudge : {1e-8, 1e-6, 0.0}) {
    for (const Point& q : points) {
      std::vector<int> active;
      if (!form_.parameter_rows.contains(q.data(), 0.0)) continue;
      if (solve_at(q, nudge, active) == QpStatus::kOptimal) see_and_build(active);
      if (!regions_.empty()) return;
      if (statistics_.saturated_active_sets > 0 && options_.output) return;
    }
  }
}

int RegionExplorer::region_holding(const double* q) const {
  for (std::size_t r = 0; r < regions_.size(); ++r) {
    if (regions_[r].polytope.facets.contains(q, kInside)) return static_cast<int>(r);
  }
  return -1;
}

// Across the facet that q violates most, again and again.
int RegionExplorer::walk_to(const double* q, int start) const {
  int region = start;
  for (int step = 0; step < 100; ++step) {
    const ExploredRegion& here = regions_[index(region)];
    const HalfSpaces& facets = here.polytope.facets;
    int worst = -1;
    double excess = kInside;
    for (int f = 0; f < facets.size(); ++f) {
      const double e = facets.product(f, q) - facets.offset(f);
      if (e > excess) {
        excess = e;
        worst = f;
      }
    }
    if (worst < 0) return region;
    const std::vector<int>& neighbours = here.neighbours[index(worst)];
    if (neighbours.empty()) return -1;
    region = neighbours[index(step) % neighbours.size()];
  }
  return -1;
}

bool RegionExplorer::check_random_points() {
  std::mt19937 random(options_.seed + 1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<int> active;
  Point q{};
  int last = 0;
  for (int i = 0; i < options_.random_points; ++i) {
    if (i % 256 == 0 && !report(false)) throw Cancelled();
    for (int j = 0; j < form_.parameters; ++j) q[index(j)] = uniform(random);
    if (!form_.parameter_rows.contains(q.data(), 0.0)) continue;
    ++statistics_.random_points;
    if (!regions_.empty()) {
      const int found = walk_to(q.data(), last);
      if (found >= 0) {
        last = found;
        continue;
      }
    }
    if (solve_at(q, 0.0, active) == QpStatus::kInfeasible) {
      ++statistics_.infeasible_points;
      active.clear();
      continue;
    }
    const auto entry = known_.find(active);
    if (entry != known_.end() && seen_[index(entry->second)].built == Built::kSaturated) continue;
    if (entry != known_.end() && seen_[index(entry->second)].region >= 0) continue;
    if (region_holding(q.data()) >= 0) continue;
    if (solve_at(q, 1e-9, active) == QpStatus::kOptimal) {
      const SeenSet& seen = seen_[index(see_and_build(active))];
      if (seen.built == Built::kSaturated) continue;
      if (seen.region >= 0) {
        if (!options_.output) ++statistics_.closure_misses;
        continue;
      }
    }
    unresolved(q);
  }
  return next_ == regions_.size();
}

}  // namespace eampc::law_design
