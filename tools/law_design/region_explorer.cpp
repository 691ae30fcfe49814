#include "law_design/region_explorer.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <utility>

namespace eampc::law_design {
namespace {

// All in q, the parameters scaled to ±1.
constexpr double kStep = 1e-6;         // how far beyond a facet its neighbour is sought
constexpr double kLeastRadius = 1e-8;  // thinner regions need an error bound to be left out
constexpr double kForcedRadius = 1e-11;
constexpr double kInside = 1e-10;    // excess of a facet that still counts as inside
constexpr double kFlatError = 1e-9;  // of the largest optimal z, whose norm is 1
constexpr double kSaturated = 1e-9;  // of the output's range

constexpr int kFlatRegion = -1;
constexpr int kSaturatedRegion = -2;
constexpr int kParameterLabel = -2;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

std::vector<int> flipped(const std::vector<int>& active, int row) {
  std::vector<int> result = active;
  const auto position = std::lower_bound(result.begin(), result.end(), row);
  if (position != result.end() && *position == row) {
    result.erase(position);
  } else {
    result.insert(position, row);
  }
  return result;
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

RegionExplorer::RegionExplorer(const LeastDistanceForm& form, const MpQpOptions& options)
    : form_(form),
      options_(options),
      program_(form.rows, form.tolerances),
      reducer_(form.parameters),
      factor_(form.variables),
      right_side_(static_cast<std::size_t>(form.rows.rows() + 1)),
      region_rows_(form.parameters) {
  if (options_.output) {
    const OutputLaw& output = *options_.output;
    output_z_ = output.Y_U * form_.back;
    output_q_ = output.Y_U * form_.shift;
    output_q_.head(form_.parameters) += output.Y_p * form_.half_width.asDiagonal();
    output_q_(form_.parameters) += output.Y_p * form_.centre + output.y_0;
  }
}

bool RegionExplorer::solve_active_set(const std::vector<int>& active) {
  const Eigen::Index np = form_.parameters;
  factor_.clear();
  for (const int row : active) {
    if (!factor_.append(form_.rows.row(row).data())) return false;
  }
  const Eigen::Index k = factor_.size();
  z_.resize(form_.variables, np + 1);
  lambda_.resize(std::max<Eigen::Index>(k, 1), np + 1);
  std::vector<double>& d = right_side_of_active_;
  d.resize(active.size());
  for (Eigen::Index c = 0; c <= np; ++c) {
    for (std::size_t i = 0; i < active.size(); ++i) d[i] = form_.bounds(active[i], c);
    factor_.least_norm(d.data(), z_.col(c).data(), lambda_.col(c).data());
  }
  return true;
}

bool RegionExplorer::output_is_saturated() const {
  if (!options_.output) return false;
  const OutputLaw& output = *options_.output;
  const Eigen::RowVectorXd y = output_z_ * z_ + output_q_;
  const double tolerance = kSaturated * (output.y_max - output.y_min);
  const double slope = y.head(form_.parameters).lpNorm<1>();
  const double middle = y(form_.parameters);
  return middle - slope >= output.y_max - tolerance || middle + slope <= output.y_min + tolerance;
}

RegionExplorer::Built RegionExplorer::build(const std::vector<int>& active, double least_radius,
                                            ExploredRegion& region) {
  const Eigen::Index n = form_.variables;
  const Eigen::Index np = form_.parameters;
  const Eigen::Index m = form_.rows.rows();
  if (!solve_active_set(active)) return Built::kEmpty;
  const Eigen::Index k = factor_.size();
  const Eigen::MatrixXd& z = z_;
  const Eigen::MatrixXd& lambda = lambda_;
  region.active = active;
  region.z = z;

  region_rows_.clear();
  region_labels_.clear();
  // Adds a·(q, 1) ≥ 0, scaled to a unit row; false if it excludes every q.
  const auto add = [&](const double* a, double scale, int label) {
    double norm = 0.0;
    for (Eigen::Index j = 0; j < np; ++j) norm += a[j] * a[j];
    norm = std::sqrt(norm);
    if (norm <= 1e-12 * scale) return a[np] >= -1e-11 * scale;
    Point normal{};
    for (Eigen::Index j = 0; j < np; ++j) normal[static_cast<std::size_t>(j)] = -a[j] / norm;
    region_rows_.append(normal.data(), a[np] / norm);
    region_labels_.push_back(label);
    return true;
  };
  std::array<double, kMaxDimension + 1> a{};
  for (Eigen::Index i = 0; i < k; ++i) {
    double scale = 0.0;
    for (Eigen::Index c = 0; c <= np; ++c) {
      a[static_cast<std::size_t>(c)] = lambda(i, c);
      scale = std::max(scale, std::abs(lambda(i, c)));
    }
    if (!add(a.data(), scale, active[static_cast<std::size_t>(i)])) return Built::kEmpty;
  }
  std::size_t next_active = 0;
  for (Eigen::Index i = 0; i < m; ++i) {
    if (next_active < active.size() && active[next_active] == i) {
      ++next_active;
      continue;
    }
    double scale = 0.0;
    const double* row = form_.rows.data() + i * n;
    const double* bound = form_.bounds.data() + i * (np + 1);
    for (Eigen::Index c = 0; c <= np; ++c) {
      const double* column = z.data() + c * n;
      double sum = 0.0;
      for (Eigen::Index j = 0; j < n; ++j) sum += row[j] * column[j];
      a[static_cast<std::size_t>(c)] = bound[c] - sum;
      scale = std::max(scale, std::abs(bound[c]) + std::abs(sum));
    }
    if (!add(a.data(), scale, static_cast<int>(i))) return Built::kEmpty;
  }
  for (int i = 0; i < form_.parameter_rows.size(); ++i) {
    Point normal{};
    form_.parameter_rows.copy_normal(i, normal.data());
    region_rows_.append(normal.data(), form_.parameter_rows.offset(i));
    region_labels_.push_back(kParameterLabel);
  }
  if (!reducer_.reduce(region_rows_, region_labels_, least_radius, region.polytope)) {
    return Built::kFlat;
  }
  region.neighbours.assign(region.polytope.labels.size(), {});
  region.facet_kinds.clear();
  for (const int label : region.polytope.labels) {
    region.facet_kinds.push_back(label == kBoxLabel         ? FacetKind::kBox
                                 : label == kParameterLabel ? FacetKind::kParameterRow
                                                            : FacetKind::kInner);
  }
  return Built::kFull;
}

int RegionExplorer::adopt(ExploredRegion&& region) {
  const int id = static_cast<int>(regions_.size());
  if (id >= options_.max_regions) {
    throw std::runtime_error("mpQP: more than " + std::to_string(options_.max_regions) +
                             " critical regions; constrain fewer stages, free fewer moves or "
                             "shrink the parameter box");
  }
  known_[region.active] = id;
  regions_.push_back(std::move(region));
  return id;
}

int RegionExplorer::region_of(const std::vector<int>& active) {
  const auto found = known_.find(active);
  if (found != known_.end()) return found->second;
  ExploredRegion region;
  if (options_.output && solve_active_set(active) && output_is_saturated()) {
    ++statistics_.saturated_active_sets;
    known_[active] = kSaturatedRegion;
    return kSaturatedRegion;
  }
  if (build(active, kLeastRadius, region) != Built::kFull) {
    known_[active] = kFlatRegion;
    return kFlatRegion;
  }
  return adopt(std::move(region));
}

int RegionExplorer::region_holding(const double* q) const {
  for (std::size_t r = 0; r < regions_.size(); ++r) {
    if (regions_[r].polytope.facets.contains(q, kInside)) return static_cast<int>(r);
  }
  return -1;
}

void RegionExplorer::link(int region, int facet, int neighbour) {
  if (neighbour < 0 || neighbour == region) return;
  std::vector<int>& list = regions_[index(region)].neighbours[index(facet)];
  if (std::find(list.begin(), list.end(), neighbour) == list.end()) list.push_back(neighbour);
}

bool RegionExplorer::accept_flat(const std::vector<int>& active, int region, int facet,
                                 const Point& q) {
  // Between the two laws lies z_flat − z_region, which vanishes on the shared facet; so over the
  // flat region it is bounded by its slope times the region's extent beyond that facet.
  ExploredRegion flat;
  if (build(active, 2.0, flat) == Built::kEmpty) return false;
  const ExploredRegion& from = regions_[index(region)];
  const Eigen::Index np = form_.parameters;
  const auto slope = (flat.z - from.z).leftCols(np);
  Eigen::VectorXd at_q = (flat.z - from.z).col(np);
  Point normal{};
  from.polytope.facets.copy_normal(facet, normal.data());
  for (Eigen::Index j = 0; j < np; ++j) {
    at_q += (flat.z - from.z).col(j) * q[static_cast<std::size_t>(j)];
  }
  if (at_q.lpNorm<Eigen::Infinity>() > kFlatError) return false;
  const LpResult extent = reducer_.support().maximise(normal.data(), region_rows_);
  if (extent.status == LpStatus::kInfeasible) return true;  // a point's rounding, nothing more
  if (extent.status != LpStatus::kOptimal) return false;
  const double width = std::max(extent.value - from.polytope.facets.offset(facet), 0.0);
  return slope.norm() * width <= kFlatError;
}

void RegionExplorer::cross(int region, int facet, const Point& on_facet, bool first) {
  cross_by(region, facet, on_facet, kStep, first);
}

void RegionExplorer::cross_by(int region, int facet, const Point& on_facet, double step,
                              bool first) {
  const int np = form_.parameters;
  Point q = on_facet;
  const Polytope& polytope = regions_[index(region)].polytope;
  double beyond = -polytope.facets.offset(facet);
  for (int j = 0; j < np; ++j) {
    const double a = polytope.facets.normal(facet, j);
    q[index(j)] = std::clamp(q[index(j)] + step * a, -1.0, 1.0);
    beyond += a * q[index(j)];
  }
  if (beyond < 0.01 * step) return;  // only the edge of the box lies here
  if (!first) ++statistics_.closure_points;
  for (const int neighbour : regions_[index(region)].neighbours[index(facet)]) {
    if (regions_[index(neighbour)].polytope.facets.contains(q.data(), kInside)) return;
  }
  const std::vector<int> flip =
      flipped(regions_[index(region)].active, polytope.labels[index(facet)]);
  std::vector<int> active = flip;
  form_.right_side(q.data(), right_side_.data());
  QpStatus status = program_.solve(right_side_.data(), active);
  if (status == QpStatus::kFailed) {
    active.clear();
    status = program_.solve(right_side_.data(), active);
  }
  if (status == QpStatus::kInfeasible || !form_.parameter_rows.contains(q.data(), 0.0)) {
    ++statistics_.infeasible_points;
    return;
  }
  if (status == QpStatus::kFailed) {
    if (region_holding(q.data()) < 0) ++statistics_.unresolved_points;
    return;
  }
  const std::size_t before = regions_.size();
  int neighbour = region_of(active);
  if (active != flip) {
    ++statistics_.degenerate_fallbacks;
    if (first) region_of(flip);
  }
  if (neighbour == kSaturatedRegion) return;
  if (neighbour >= 0) {
    const Polytope& other = regions_[index(neighbour)].polytope;
    if (!first && static_cast<std::size_t>(neighbour) >= before) ++statistics_.closure_misses;
    if (neighbour == region || other.facets.contains(q.data(), 1e-8)) {
      link(region, facet, neighbour);
      return;
    }
  }
  // A flat or ill-conditioned active set.
  const int holder = region_holding(q.data());
  if (holder >= 0) {
    link(region, facet, holder);
    return;
  }
  if (accept_flat(active, region, facet, q)) {
    ++statistics_.flat_regions_dropped;
    if (step < 1e-3) cross_by(region, facet, on_facet, 10.0 * step, first);
    return;
  }
  ExploredRegion thin;
  if (neighbour < 0 && build(active, kForcedRadius, thin) == Built::kFull) {
    link(region, facet, adopt(std::move(thin)));
    return;
  }
  ++statistics_.unresolved_points;
}

void RegionExplorer::report() {
  if (!options_.progress) return;
  if (!options_.progress(static_cast<int>(next_), static_cast<int>(regions_.size()))) {
    throw Cancelled();
  }
}

void RegionExplorer::explore_queue() {
  while (next_ < regions_.size()) {
    if (next_ % 64 == 0) report();
    const int region = static_cast<int>(next_);
    const std::size_t facets = regions_[next_].polytope.labels.size();
    for (std::size_t f = 0; f < facets; ++f) {
      if (regions_[next_].polytope.labels[f] < 0) continue;
      const Point on_facet = regions_[next_].polytope.facet_points[f];
      cross(region, static_cast<int>(f), on_facet, true);
    }
    ++next_;
  }
}

bool RegionExplorer::check_closure() {
  const int np = form_.parameters;
  const int wanted =
      options_.closure_points_per_facet > 0 ? options_.closure_points_per_facet : 2 * np;
  std::mt19937 random(options_.seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  while (closed_ < regions_.size()) {
    if (closed_ % 64 == 0) report();
    const int region = static_cast<int>(closed_);
    const std::size_t facets = regions_[closed_].polytope.labels.size();
    for (std::size_t f = 0; f < facets; ++f) {
      if (regions_[closed_].polytope.labels[f] < 0) continue;
      const int facet = static_cast<int>(f);
      Point middle = regions_[closed_].polytope.facet_points[f];
      for (int pair = 0; 2 * pair < wanted; ++pair) {
        const Polytope& polytope = regions_[closed_].polytope;
        // A random line in the facet through its middle, and both ends of the chord.
        Point line{};
        double along = 0.0;
        for (int j = 0; j < np; ++j) {
          line[index(j)] = uniform(random);
          along += line[index(j)] * polytope.facets.normal(facet, j);
        }
        for (int j = 0; j < np; ++j) {
          line[index(j)] -= along * polytope.facets.normal(facet, j);
        }
        double forward = 4.0;
        double backward = 4.0;
        for (int i = 0; i < polytope.facets.size(); ++i) {
          if (i == facet) continue;
          const double speed = polytope.facets.product(i, line.data());
          const double slack =
              std::max(polytope.facets.offset(i) - polytope.facets.product(i, middle.data()), 0.0);
          if (speed > 1e-14) forward = std::min(forward, slack / speed);
          if (speed < -1e-14) backward = std::min(backward, -slack / speed);
        }
        Point ends[2];
        for (int j = 0; j < np; ++j) {
          const double x = middle[index(j)];
          ends[0][index(j)] = x + 0.97 * forward * line[index(j)];
          ends[1][index(j)] = x - 0.97 * backward * line[index(j)];
          middle[index(j)] = x + 0.5 * (forward - backward) * line[index(j)];
        }
        for (int j = np; j < kMaxDimension; ++j) ends[0][index(j)] = ends[1][index(j)] = 0.0;
        cross(region, facet, ends[0], false);
        cross(region, facet, ends[1], false);
      }
    }
    ++closed_;
    if (next_ < regions_.size()) return false;
  }
  return true;
}

bool RegionExplorer::check_random_points() {
  std::mt19937 random(options_.seed + 1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<int> active;
  Point q{};
  for (int i = 0; i < options_.random_points; ++i) {
    for (int j = 0; j < form_.parameters; ++j) q[index(j)] = uniform(random);
    if (!form_.parameter_rows.contains(q.data(), 0.0)) continue;
    form_.right_side(q.data(), right_side_.data());
    const QpStatus status = program_.solve(right_side_.data(), active);
    if (status == QpStatus::kInfeasible) {
      ++statistics_.infeasible_points;
      active.clear();
      continue;
    }
    ++statistics_.closure_points;
    const auto found = known_.find(active);
    if (status == QpStatus::kOptimal && found != known_.end() && found->second != kFlatRegion) {
      continue;
    }
    if (region_holding(q.data()) >= 0) continue;
    if (status == QpStatus::kOptimal && region_of(active) == kSaturatedRegion) continue;
    ++statistics_.closure_misses;
    if (status != QpStatus::kOptimal || region_of(active) == kFlatRegion) {
      ++statistics_.unresolved_points;
    }
  }
  return next_ == regions_.size();
}

void RegionExplorer::run() {
  std::vector<int> active;
  for (const Eigen::VectorXd& q : form_.feasible_points) {
    form_.right_side(q.data(), right_side_.data());
    if (program_.solve(right_side_.data(), active) == QpStatus::kOptimal) region_of(active);
    if (!regions_.empty()) break;
  }
  if (regions_.empty()) check_random_points();
  do {
    do {
      explore_queue();
    } while (!check_closure());
  } while (!check_random_points());
  report();
  statistics_.lps = reducer_.lp_count();
  statistics_.qps = program_.count();
  statistics_.regions = static_cast<int>(regions_.size());
}

}  // namespace eampc::law_design
