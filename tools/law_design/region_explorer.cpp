#include "law_design/region_explorer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "law_design/parallel_range.hpp"

namespace eampc::law_design {
namespace {

// All in q, the parameters scaled to ±1.
constexpr double kLeastRadius = 1e-10;   // thinner regions are flat unless they prove needed
constexpr double kForcedRadius = 1e-11;  // thinner ones cannot be told from rounding
constexpr double kCoincident = 1e-8;     // planes this close share a facet
constexpr double kInside = 1e-9;         // excess of a facet that still counts as inside
constexpr double kSliver = 1e-8;         // facets of a smaller radius may have nothing beyond
constexpr double kThin = 1e-8;           // sets thinner than this along a ray are passed over
constexpr double kJump = 1e-8;           // of the largest optimal z, whose norm is 1: sought …
constexpr double kLargestJump = 1e-6;    // … and accepted where rounding allows no better
constexpr int kDeepest = 64;             // flat sets on the way through one facet
constexpr int kRound = 4096;             // regions crossed in one round
constexpr int kWorthThreads = 32;        // sets to build
constexpr double kReportEvery_s = 0.1;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

std::size_t RegionExplorer::ActiveSetHash::operator()(const std::vector<int>& active) const {
  std::size_t hash = 1469598103934665603U;  // FNV-1a
  for (const int row : active) {
    hash ^= static_cast<std::size_t>(row) + 1U;
    hash *= 1099511628211U;
  }
  return hash;
}

RegionExplorer::RegionExplorer(const LeastDistanceForm& form, const MpQpOptions& options,
                               std::chrono::steady_clock::time_point start)
    : form_(form),
      options_(options),
      start_(start),
      reported_(start),
      threads_(thread_count(options.threads)),
      program_(form.rows, form.tolerances),
      right_side_(static_cast<std::size_t>(form.rows.rows() + 1)) {
  for (int t = 0; t < threads_; ++t) {
    builders_.push_back(std::make_unique<RegionBuilder>(form, options));
  }
}

bool RegionExplorer::report(bool now) {
  if (seconds_since(start_) > options_.time_limit_s) {
    throw TimeLimit("mpQP: the time limit is over with " + std::to_string(regions_.size()) +
                    " regions found and " + std::to_string(regions_.size() - next_) +
                    " of them not yet explored; raise it, shrink the parameter box, or use fewer "
                    "rows or variables");
  }
  if (!options_.progress || (!now && seconds_since(reported_) < kReportEvery_s)) return true;
  reported_ = std::chrono::steady_clock::now();
  return options_.progress(static_cast<int>(next_), static_cast<int>(regions_.size()));
}

int RegionExplorer::see(std::vector<int> active) {
  const auto [entry, is_new] =
      known_.try_emplace(std::move(active), static_cast<int>(seen_.size()));
  if (is_new) {
    listed_.push_back(entry->second);
    seen_.emplace_back();
    seen_.back().active = &entry->first;
  }
  return entry->second;
}

void RegionExplorer::build_listed() {
  const int count = static_cast<int>(listed_.size());
  std::vector<ExploredRegion> built(index(count));
  const auto work = [&](int i, int thread) {
    SeenSet& seen = seen_[index(listed_[index(i)])];
    RegionBuilder& builder = *builders_[index(thread)];
    seen.built = builder.build(*seen.active, kLeastRadius, built[index(i)]);
    if (seen.built == Built::kFlat) seen.rows = std::make_unique<RegionRows>(builder.rows());
  };
  parallel_range(count, count < kWorthThreads ? 1 : threads_, work,
                 [&](int, int) { return report(false); });
  for (int i = 0; i < count; ++i) {
    SeenSet& seen = seen_[index(listed_[index(i)])];
    if (seen.built == Built::kSaturated) ++statistics_.saturated_active_sets;
    if (seen.built == Built::kFlat) ++statistics_.flat_active_sets;
    if (seen.built == Built::kFull) adopt(std::move(built[index(i)]), seen);
  }
  listed_.clear();
}

int RegionExplorer::see_and_build(std::vector<int> active) {
  const int seen = see(std::move(active));
  build_listed();
  return seen;
}

void RegionExplorer::adopt(ExploredRegion&& region, SeenSet& seen) {
  seen.built = Built::kFull;
  seen.region = static_cast<int>(regions_.size());
  if (seen.region >= options_.max_regions) {
    throw std::runtime_error("mpQP: more than " + std::to_string(options_.max_regions) +
                             " critical regions; constrain fewer stages, free fewer moves or "
                             "shrink the parameter box");
  }
  regions_.push_back(std::move(region));
}

void RegionExplorer::link(int region, int facet, int neighbour) {
  if (neighbour == region) return;
  std::vector<int>& list = regions_[index(region)].neighbours[index(facet)];
  if (std::find(list.begin(), list.end(), neighbour) == list.end()) list.push_back(neighbour);
}

// True if `other` has a facet in the plane of this one, from the other side.
bool RegionExplorer::shares_plane(int region, int facet, int other) const {
  const HalfSpaces& own = regions_[index(region)].polytope.facets;
  const HalfSpaces& others = regions_[index(other)].polytope.facets;
  for (int g = 0; g < others.size(); ++g) {
    double apart = std::abs(own.offset(facet) + others.offset(g));
    for (int j = 0; j < form_.parameters; ++j) {
      apart = std::max(apart, std::abs(own.normal(facet, j) + others.normal(g, j)));
    }
    if (apart <= 1e-6) return true;
  }
  return false;
}

void RegionExplorer::take(const Step& step, FacetOutcome& outcome, std::vector<Step>& further) {
  const SeenSet& seen = seen_[index(step.seen)];
  switch (seen.built) {
    case Built::kFull:
      if (step.sliver >= 0) {
        if (!regions_[index(seen.region)].polytope.facets.contains(step.at.data(), kThin)) return;
        if (jump(step.region, seen.region, step.at) > kJump ||
            !pass_over(step.region, step.facet, seen.region, step.at)) {
          outcome.failed = true;
          outcome.sliver = step.sliver;
          outcome.at = step.at;
        }
      } else if (shares_plane(step.region, step.facet, seen.region)) {
        link(step.region, step.facet, seen.region);
      }  // else it meets the facet in less than a facet, if at all
      return;
    case Built::kSaturated:
      outcome.saturated = true;
      return;
    case Built::kEmpty:
      return;
    case Built::kFlat:
      walk_through(step, outcome, further);
  }
}

// The row through which the ray from a point of a facet leaves a set, if that is very near.
int RegionExplorer::exit_of_ray(const RegionRows& rows, const HalfSpaces& facets, int facet,
                                const Point& from) const {
  int exit = -1;
  double nearest = kThin;
  for (int i = 0; i < rows.rows.size(); ++i) {
    double along = 0.0;
    for (int j = 0; j < form_.parameters; ++j) {
      along += rows.rows.normal(i, j) * facets.normal(facet, j);
    }
    if (along < 0.1) continue;
    const double distance = (rows.rows.offset(i) - rows.rows.product(i, from.data())) / along;
    if (distance >= nearest) continue;
    nearest = distance;
    exit = i;
  }
  return exit;
}

// The perturbed problem's region of a flat set is a thin layer on the facet; the plane that bounds
// it on the far side is the facet's own at ε = 0.
void RegionExplorer::walk_through(const Step& step, FacetOutcome& outcome,
                                  std::vector<Step>& further) {
  ++statistics_.degenerate_fallbacks;
  const SeenSet& seen = seen_[index(step.seen)];
  const HalfSpaces& facets = regions_[index(step.region)].polytope.facets;
  const RegionRows& rows = *seen.rows;
  int exit = -1;
  double least = 0.0;
  for (int i = 0; i < rows.rows.size(); ++i) {
    double apart = std::abs(rows.rows.offset(i) - facets.offset(step.facet));
    for (int j = 0; j < form_.parameters; ++j) {
      apart = std::max(apart, std::abs(rows.rows.normal(i, j) - facets.normal(step.facet, j)));
    }
    if (apart > kCoincident + rows.roundings[index(i)]) continue;
    if (exit < 0 || rows.shifts[index(i)] < least) {
      exit = i;
      least = rows.shifts[index(i)];
    }
  }
  // A set that takes the facet over in another part of it, or nowhere.
  Point middle{};
  RegionBuilder& builder = *builders_.front();
  const Polytope& polytope = regions_[index(step.region)].polytope;
  if (builder.shared_radius(rows, polytope, step.facet, middle) < kSliver) return;
  const bool thin = exit < 0;
  if (thin) exit = exit_of_ray(rows, facets, step.facet, middle);
  if (exit < 0 || step.depth >= kDeepest) {
    outcome.failed = true;
    outcome.at = middle;
    return;
  }
  if (rows.labels[index(exit)] == kParameterLabel) {
    outcome.infeasible = true;
    return;
  }
  const std::vector<int> active = *seen.active;
  std::vector<Crossing> crossings;
  builder.factorise(active);
  builder.cross(step.facet, rows.labels[index(exit)], crossings);
  if (crossings.empty()) outcome.infeasible = true;
  for (const Crossing& crossing : crossings) {
    further.push_back({step.region, step.facet, see(crossed(active, crossing)), step.depth + 1,
                       thin ? step.seen : step.sliver, thin ? middle : step.at});
  }
}

void RegionExplorer::explore_round() {
  const int first = static_cast<int>(next_);
  const int last = std::min(static_cast<int>(regions_.size()), first + kRound);
  std::vector<std::vector<FacetOutcome>> outcomes(index(last - first));
  std::vector<Step> steps, further;
  for (int region = first; region < last; ++region) {
    const ExploredRegion& from = regions_[index(region)];
    outcomes[index(region - first)].resize(from.facet_kinds.size());
    for (const Crossing& crossing : from.crossings) {
      steps.push_back({region, crossing.facet, see(crossed(from.active, crossing)), 0, -1, {}});
    }
  }
  while (!steps.empty()) {
    build_listed();
    for (const Step& step : steps) {
      take(step, outcomes[index(step.region - first)][index(step.facet)], further);
    }
    steps.swap(further);
    further.clear();
  }
  for (int region = first; region < last; ++region) {
    for (std::size_t f = 0; f < outcomes[index(region - first)].size(); ++f) {
      settle(region, static_cast<int>(f), outcomes[index(region - first)][f]);
    }
    regions_[index(region)].crossings = {};
  }
  next_ = index(last);
  if (!report(false)) throw Cancelled();
}

void RegionExplorer::settle(int region, int facet, const FacetOutcome& outcome) {
  FacetKind& kind = regions_[index(region)].facet_kinds[index(facet)];
  if (kind == FacetKind::kInfeasible) ++statistics_.infeasible_facets;
  if (kind != FacetKind::kInner) return;
  if (outcome.saturated) {
    kind = FacetKind::kSaturated;
    return;
  }
  if (outcome.sliver >= 0 && adopt_thin(outcome.sliver)) {
    link(region, facet, seen_[index(outcome.sliver)].region);
  } else if (outcome.failed) {
    step_across(region, facet, outcome.at);
  } else if (regions_[index(region)].neighbours[index(facet)].empty()) {
    if (outcome.infeasible) {
      kind = FacetKind::kInfeasible;
      ++statistics_.infeasible_facets;
    } else {
      Point middle = regions_[index(region)].polytope.facet_points[index(facet)];
      const RegionRows none{HalfSpaces(form_.parameters), {}, {}, {}};
      builders_.front()->shared_radius(none, regions_[index(region)].polytope, facet, middle);
      step_across(region, facet, middle);
    }
  }
}

double RegionExplorer::jump(int region, int other, const Point& q) const {
  const Eigen::Index np = form_.parameters;
  const auto difference = regions_[index(region)].z - regions_[index(other)].z;
  Eigen::VectorXd at_q = difference.col(np);
  for (Eigen::Index j = 0; j < np; ++j) {
    at_q += difference.col(j) * q[static_cast<std::size_t>(j)];
  }
  return at_q.lpNorm<Eigen::Infinity>();
}

// True if the other region's solution is good enough for the sliver that hides between.
bool RegionExplorer::pass_over(int region, int facet, int other, const Point& q) {
  const double wrong_by = jump(region, other, q);
  if (wrong_by > kLargestJump) {
    refused_jump_ = std::min(refused_jump_, wrong_by);
    return false;
  }
  statistics_.largest_jump = std::max(statistics_.largest_jump, wrong_by);
  ++statistics_.flat_regions_dropped;
  link(region, facet, other);
  return true;
}

void RegionExplorer::unresolved(const Point& q) {
  if (statistics_.unresolved_points++ > 0) return;
  unresolved_at_ = q;
  unresolved_jump_ = refused_jump_;
}

// No set beyond the facet has a region: rounding. Either the facet is a sliver, or a sliver lies
// beyond it; then what is found a little further on must be as good there.
void RegionExplorer::step_across(int region, int facet, const Point& middle) {
  ++statistics_.stepped_facets;
  refused_jump_ = std::numeric_limits<double>::infinity();
  const int np = form_.parameters;
  const Polytope polytope = regions_[index(region)].polytope;
  int thin = -1;
  for (const double step : {1e-8, 1e-7, 1e-6, 1e-5, 1e-4}) {
    Point q = middle;
    double beyond = -polytope.facets.offset(facet);
    for (int j = 0; j < np; ++j) {
      const double a = polytope.facets.normal(facet, j);
      q[index(j)] = std::clamp(q[index(j)] + step * a, -1.0, 1.0);
      beyond += a * q[index(j)];
    }
    if (beyond < 0.01 * step) return;  // only the edge of the box lies here
    if (!form_.parameter_rows.contains(q.data(), 0.0)) {
      regions_[index(region)].facet_kinds[index(facet)] = FacetKind::kParameterRow;
      return;
    }
    // A sliver of a facet, cut off by less than a step.
    if (polytope.facets.contains(q.data(), kInside)) return;
    std::vector<int> active = regions_[index(region)].active;
    const QpStatus status = solve_at(q, 1e-3 * step, active);
    if (status == QpStatus::kInfeasible) {
      regions_[index(region)].facet_kinds[index(facet)] = FacetKind::kInfeasible;
      ++statistics_.infeasible_facets;
      return;
    }
    if (status == QpStatus::kFailed) continue;
    const int seen = see_and_build(active);
    if (seen_[index(seen)].built == Built::kSaturated) {
      regions_[index(region)].facet_kinds[index(facet)] = FacetKind::kSaturated;
      return;
    }
    const int other = seen_[index(seen)].region;
    if (other >= 0 && regions_[index(other)].polytope.facets.contains(q.data(), kInside)) {
      if (pass_over(region, facet, other, middle)) return;
      continue;
    }
    if (thin < 0 && seen_[index(seen)].built == Built::kFlat) thin = seen;
    const int holder = region_holding(q.data());
    if (holder >= 0 && pass_over(region, facet, holder, middle)) return;
  }
  if (thin >= 0 && adopt_thin(thin)) {
    link(region, facet, seen_[index(thin)].region);
    return;
  }
  Point centre{};
  const RegionRows none{HalfSpaces(np), {}, {}, {}};
  if (builders_.front()->shared_radius(none, polytope, facet, centre) < kSliver) return;
  unresolved(middle);
}

bool RegionExplorer::adopt_thin(int seen) {
  if (seen_[index(seen)].region >= 0) return true;
  ExploredRegion region;
  if (builders_.front()->build(*seen_[index(seen)].active, kForcedRadius, region) != Built::kFull) {
    return false;
  }
  ++statistics_.thin_regions;
  adopt(std::move(region), seen_[index(seen)]);
  return true;
}

void RegionExplorer::link_both_ways() {
  for (std::size_t r = 0; r < regions_.size(); ++r) {
    for (std::size_t f = 0; f < regions_[r].neighbours.size(); ++f) {
      for (const int other : regions_[r].neighbours[f]) {
        const HalfSpaces& own = regions_[r].polytope.facets;
        const HalfSpaces& others = regions_[index(other)].polytope.facets;
        for (int g = 0; g < others.size(); ++g) {
          double apart = std::abs(own.offset(static_cast<int>(f)) + others.offset(g));
          for (int j = 0; j < form_.parameters; ++j) {
            apart =
                std::max(apart, std::abs(own.normal(static_cast<int>(f), j) + others.normal(g, j)));
          }
          if (apart <= 1e-6) link(other, g, static_cast<int>(r));
        }
      }
    }
  }
}

void RegionExplorer::run() {
  if (!report(true)) throw Cancelled();
  find_first_region();
  do {
    while (next_ < regions_.size()) explore_round();
  } while (!check_random_points());
  link_both_ways();
  if (!report(true)) throw Cancelled();
  for (const auto& builder : builders_) statistics_.lps += builder->lp_count();
  statistics_.qps = program_.count();
  statistics_.regions = static_cast<int>(regions_.size());
}

}  // namespace eampc::law_design
