#include "law_design/region_builder.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace eampc::law_design {
namespace {

// Relative size of a constraint's slope in q below which it counts as constant, at best …
constexpr double kConstant = 1e-12;
// … and times the condition of the active rows: some hundred roundings.
constexpr double kRounding = 3e-14;
// Planes this close, beyond rounding, count as one. In q, the parameters scaled to ±1.
constexpr double kCoincident = 1e-9;
// Share of an active row in a dependent one that counts as none: the exchange would leave
// dependent rows.
constexpr double kShare = ActiveRows::kDependent;
constexpr double kParallel = 1e-9;   // sine of the angle of planes that count as parallel
constexpr double kSaturated = 1e-9;  // of the output's range

constexpr std::size_t index(Eigen::Index i) { return static_cast<std::size_t>(i); }

// A number in [0.5, 1.5) that shares no pattern with the row numbers (splitmix64).
double scattered(int row) {
  std::uint64_t x = 0x9e3779b97f4a7c15U * (static_cast<std::uint64_t>(row) + 1U);
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  x ^= x >> 31U;
  return 0.5 + static_cast<double>(x >> 11U) * 0x1p-53;
}

int padded(int width) { return (width + 3) / 4 * 4; }

}  // namespace

std::vector<int> crossed(const std::vector<int>& active, const Crossing& crossing) {
  std::vector<int> result;
  result.reserve(active.size() + 1);
  for (const int row : active) {
    if (row != crossing.leaving) result.push_back(row);
  }
  if (crossing.entering >= 0) {
    result.insert(std::lower_bound(result.begin(), result.end(), crossing.entering),
                  crossing.entering);
  }
  return result;
}

RegionBuilder::RegionBuilder(const LeastDistanceForm& form, const MpQpOptions& options)
    : form_(form),
      options_(options),
      reducer_(form.parameters),
      slice_(form.parameters + 1),
      slice_rows_(form.parameters + 1),
      factor_(form.variables),
      width_(padded(form.parameters + 2)),
      remainder_(index(form.variables)),
      coefficients_(index(form.variables + 1)) {
  rows_.rows = HalfSpaces(form.parameters);
  slice_.set_bounds(form.parameters, -4.0, 2.0);
  slice_.set_perturbation(1e-12);
  const std::size_t width = index(width_);
  data_.assign(index(form.rows.rows()) * width, 0.0);
  z_.assign(index(form.variables) * width, 0.0);
  lambda_.assign(index(form.variables) * width, 0.0);
  for (Eigen::Index i = 0; i < form.rows.rows(); ++i) {
    nudges_.push_back(scattered(form.original_rows[index(i)]));
    double* row = data_.data() + index(i) * width;
    for (Eigen::Index c = 0; c <= form.parameters; ++c) row[c] = form.bounds(i, c);
    row[form.parameters + 1] = nudges_.back();
  }
  if (options_.output) {
    const OutputLaw& output = *options_.output;
    output_z_ = output.Y_U * form_.back;
    output_q_ = output.Y_U * form_.shift;
    output_q_.head(form_.parameters) += output.Y_p * form_.half_width.asDiagonal();
    output_q_(form_.parameters) += output.Y_p * form_.centre + output.y_0;
  }
}

bool RegionBuilder::factorise(const std::vector<int>& active) {
  active_ = active;
  factor_.clear();
  for (const int row : active) {
    if (!factor_.append(form_.rows.row(row).data())) return false;
  }
  return true;
}

// All columns of (q, 1, ε) at once: Rᵀ w = d, z = Q w, R λ = −w.
template <int kWidth>
void RegionBuilder::solve_active_set() {
  const int k = factor_.size();
  const int n = form_.variables;
  std::fill(z_.begin(), z_.end(), 0.0);
  double* lambda = lambda_.data();
  for (int i = 0; i < k; ++i) {
    double* w = lambda + i * kWidth;
    const double* d = data_.data() + active_[index(i)] * kWidth;
    for (int c = 0; c < kWidth; ++c) w[c] = d[c];
    for (int l = 0; l < i; ++l) {
      const double r = factor_.r(l, i);
      const double* other = lambda + l * kWidth;
      for (int c = 0; c < kWidth; ++c) w[c] -= r * other[c];
    }
    const double pivot = factor_.r(i, i);
    for (int c = 0; c < kWidth; ++c) w[c] /= pivot;
    const double* q = factor_.direction(i);
    for (int j = 0; j < n; ++j) {
      double* z = z_.data() + j * kWidth;
      for (int c = 0; c < kWidth; ++c) z[c] += q[j] * w[c];
    }
  }
  for (int i = k - 1; i >= 0; --i) {
    double* w = lambda + i * kWidth;
    for (int c = 0; c < kWidth; ++c) w[c] = -w[c];
    for (int l = i + 1; l < k; ++l) {
      const double r = factor_.r(i, l);
      const double* other = lambda + l * kWidth;
      for (int c = 0; c < kWidth; ++c) w[c] -= r * other[c];
    }
    const double pivot = factor_.r(i, i);
    for (int c = 0; c < kWidth; ++c) w[c] /= pivot;
  }
}

// Adds a·(q, 1, ε) ≥ 0 as a unit row; false if it excludes every q.
bool RegionBuilder::add(const double* a, double scale, double rounding, int label) {
  const int np = form_.parameters;
  double norm = 0.0;
  for (int j = 0; j < np; ++j) norm += a[j] * a[j];
  norm = std::sqrt(norm);
  const double constant = std::max(kConstant * scale, rounding);
  if (norm <= constant) {
    if (std::abs(a[np]) <= 10.0 * constant) return a[np + 1] > 0.0;
    return a[np] > 0.0;
  }
  Point normal{};
  for (int j = 0; j < np; ++j) normal[index(j)] = -a[j] / norm;
  rows_.rows.append(normal.data(), a[np] / norm);
  rows_.labels.push_back(label);
  rows_.shifts.push_back(a[np + 1] / norm);
  rows_.roundings.push_back(std::min(rounding / norm, 1e-6));
  return true;
}

template <int kWidth>
bool RegionBuilder::collect_rows() {
  const int np = form_.parameters;
  const int n = form_.variables;
  const int k = factor_.size();
  rows_.rows.clear();
  rows_.labels.clear();
  rows_.shifts.clear();
  rows_.roundings.clear();
  const double condition = 1.0 / factor_.least_pivot();
  double largest = 0.0;
  for (int i = 0; i < k; ++i) {
    for (int c = 0; c <= np; ++c) {
      largest = std::max(largest, std::abs(lambda_[index(i * kWidth + c)]));
    }
  }
  for (int i = 0; i < k; ++i) {
    const double* a = lambda_.data() + i * kWidth;
    double scale = 0.0;
    for (int c = 0; c <= np; ++c) scale = std::max(scale, std::abs(a[c]));
    if (!add(a, scale, kRounding * condition * largest, active_[index(i)])) return false;
  }
  double solution = 0.0;
  for (int j = 0; j < n; ++j) {
    for (int c = 0; c <= np; ++c) {
      solution = std::max(solution, std::abs(z_[index(j * kWidth + c)]));
    }
  }
  std::size_t next_active = 0;
  const int m = static_cast<int>(form_.rows.rows());
  for (int i = 0; i < m; ++i) {
    if (next_active < active_.size() && active_[next_active] == i) {
      ++next_active;
      continue;
    }
    const double* row = form_.rows.data() + i * n;
    const double* bound = data_.data() + i * kWidth;
    double sum[index(kWidth)] = {};
    for (int j = 0; j < n; ++j) {
      const double* z = z_.data() + j * kWidth;
      for (int c = 0; c < kWidth; ++c) sum[c] += row[j] * z[c];
    }
    double a[index(kWidth)];
    double scale = 0.0;
    for (int c = 0; c < kWidth; ++c) a[c] = bound[c] - sum[c];
    for (int c = 0; c <= np; ++c) scale = std::max(scale, std::abs(bound[c]) + std::abs(sum[c]));
    if (!add(a, scale, kRounding * condition * solution, i)) return false;
  }
  Point normal{};
  for (int i = 0; i < form_.parameter_rows.size(); ++i) {
    form_.parameter_rows.copy_normal(i, normal.data());
    rows_.rows.append(normal.data(), form_.parameter_rows.offset(i));
    rows_.labels.push_back(kParameterLabel);
    rows_.shifts.push_back(-1e300);  // no matter what ε does, nothing lies beyond
    rows_.roundings.push_back(0.0);
  }
  return true;
}

bool RegionBuilder::output_is_saturated() const {
  if (!options_.output) return false;
  const OutputLaw& output = *options_.output;
  Eigen::RowVectorXd y = output_q_;
  for (int j = 0; j < form_.variables; ++j) {
    for (int c = 0; c <= form_.parameters; ++c) {
      y(c) += output_z_(j) * z_[index(j * width_ + c)];
    }
  }
  const double tolerance = kSaturated * (output.y_max - output.y_min);
  const double slope = y.head(form_.parameters).lpNorm<1>();
  const double middle = y(form_.parameters);
  return middle - slope >= output.y_max - tolerance || middle + slope <= output.y_min + tolerance;
}

// Among rows whose planes coincide the facet is the one that ε leaves innermost.
void RegionBuilder::settle_labels(Polytope& polytope) const {
  const int np = form_.parameters;
  const int rows = rows_.rows.size();
  for (int f = 0; f < polytope.facets.size(); ++f) {
    int& label = polytope.labels[index(f)];
    if (label == kBoxLabel) continue;
    double least = 0.0;
    int best = label;
    bool first = true;
    const double b = polytope.facets.offset(f);
    for (int i = 0; i < rows; ++i) {
      if (std::abs(rows_.rows.offset(i) - b) > kCoincident + rows_.roundings[index(i)]) continue;
      bool same = true;
      for (int j = 0; j < np && same; ++j) {
        same = std::abs(rows_.rows.normal(i, j) - polytope.facets.normal(f, j)) <=
               kCoincident + rows_.roundings[index(i)];
      }
      if (!same || (!first && rows_.shifts[index(i)] >= least)) continue;
      first = false;
      least = rows_.shifts[index(i)];
      best = rows_.labels[index(i)];
    }
    label = best;
  }
}

Built RegionBuilder::build(const std::vector<int>& active, double least_radius,
                           ExploredRegion& region) {
  if (!factorise(active)) return Built::kEmpty;
  const bool narrow = width_ == 4;
  const bool middle = width_ == 8;
  narrow ? solve_active_set<4>() : middle ? solve_active_set<8>() : solve_active_set<12>();
  if (!(narrow ? collect_rows<4>() : middle ? collect_rows<8>() : collect_rows<12>())) {
    return Built::kEmpty;
  }
  if (output_is_saturated()) {
    const bool full = reducer_.holds_ball(rows_.rows, rows_.labels, least_radius);
    return full ? Built::kSaturated : Built::kFlat;
  }
  if (!reducer_.reduce(rows_.rows, rows_.labels, least_radius, region.polytope)) {
    return Built::kFlat;
  }
  region.active = active;
  const int np = form_.parameters;
  region.z.resize(form_.variables, np + 1);
  for (int j = 0; j < form_.variables; ++j) {
    for (int c = 0; c <= np; ++c) region.z(j, c) = z_[index(j * width_ + c)];
  }
  settle_labels(region.polytope);
  const int facets = region.polytope.facets.size();
  region.facet_kinds.clear();
  region.crossings.clear();
  region.neighbours.assign(index(facets), {});
  for (int f = 0; f < facets; ++f) {
    const int label = region.polytope.labels[index(f)];
    if (label < 0) {
      region.facet_kinds.push_back(label == kBoxLabel ? FacetKind::kBox : FacetKind::kParameterRow);
      continue;
    }
    const std::size_t before = region.crossings.size();
    cross(f, label, region.crossings);
    region.facet_kinds.push_back(before == region.crossings.size() ? FacetKind::kInfeasible
                                                                   : FacetKind::kInner);
  }
  return Built::kFull;
}

void RegionBuilder::cross(int facet, int label, std::vector<Crossing>& crossings) {
  if (std::binary_search(active_.begin(), active_.end(), label)) {
    crossings.push_back({facet, -1, label});
    return;
  }
  const double* row = form_.rows.row(label).data();
  if (factor_.size() < form_.variables &&
      factor_.split(row, remainder_.data()) >= ActiveRows::kDependent) {
    crossings.push_back({facet, label, -1});
    return;
  }
  factor_.coefficients(row, coefficients_.data());
  for (std::size_t i = 0; i < active_.size(); ++i) {
    if (coefficients_[i] > kShare) crossings.push_back({facet, label, active_[i]});
  }
}

double RegionBuilder::shared_radius(const RegionRows& rows, const Polytope& polytope, int facet,
                                    Point& centre) {
  const int np = form_.parameters;
  Point normal{};
  polytope.facets.copy_normal(facet, normal.data());
  const double offset = polytope.facets.offset(facet);
  slice_rows_.clear();
  std::array<double, kMaxDimension + 1> a{};
  bool apart = false;
  // Planes that are the facet's own, from either side, to within `tolerance` do not count.
  const auto add_row = [&](const HalfSpaces& from, int i, double tolerance) {
    from.copy_normal(i, a.data());
    double along = 0.0;
    for (int j = 0; j < np; ++j) along += a[index(j)] * normal[index(j)];
    const double side = along > 0.0 ? 1.0 : -1.0;
    double different = std::abs(from.offset(i) - side * offset);
    double within = 0.0;
    for (int j = 0; j < np; ++j) {
      different = std::max(different, std::abs(a[index(j)] - side * normal[index(j)]));
      const double across = a[index(j)] - along * normal[index(j)];
      within += across * across;
    }
    if (different <= tolerance) return;
    within = std::sqrt(within);
    if (within < kParallel) {
      apart |= along * offset > from.offset(i) + 3.0 * kParallel;
      return;
    }
    a[index(np)] = within;
    slice_rows_.append(a.data(), from.offset(i));
  };
  for (int i = 0; i < rows.rows.size(); ++i) {
    add_row(rows.rows, i, 1e-8 + rows.roundings[index(i)]);
  }
  for (int i = 0; i < polytope.facets.size(); ++i) {
    if (i != facet) add_row(polytope.facets, i, 0.0);
  }
  for (const double sign : {1.0, -1.0}) {
    for (int j = 0; j < np; ++j) a[index(j)] = sign * normal[index(j)];
    a[index(np)] = 0.0;
    slice_rows_.append(a.data(), sign * offset + 1e-12);
  }
  if (apart) return 0.0;
  a.fill(0.0);
  a[index(np)] = 1.0;
  const LpResult result = slice_.maximise(a.data(), slice_rows_, 0.0);
  if (result.status != LpStatus::kOptimal) return 0.0;
  for (int j = 0; j < np; ++j) centre[index(j)] = slice_.point()[j];
  return slice_.point()[np];
}

}  // namespace eampc::law_design
