#include "law_design/region_certificate.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>

namespace eampc::law_design {
namespace {

using Eigen::Index;

// Distance of a unit row from the span of the others below which it depends on them.
constexpr long double kDependent = 1e-9L;
// A condition whose slope is below this part of its terms does not depend on q.
constexpr long double kConstant = 1e-15L;
// … and may then miss its sign by this part.
constexpr long double kSign = 1e-12L;

std::size_t index(Index i) { return static_cast<std::size_t>(i); }

}  // namespace

RegionCertifier::RegionCertifier(const CertificateProblem& problem)
    : problem_(problem),
      maker_(problem.parameters),
      q_(problem.variables, problem.variables),
      r_(problem.variables, problem.variables),
      forms_(problem.rows, problem.parameters + 1),
      scales_(index(problem.rows)),
      output_(index(problem.parameters + 1)),
      rows_(problem.parameters) {}

bool RegionCertifier::append(int row) {
  if (size_ == problem_.variables || problem_.norms[index(row)] == 0.0L) return false;
  const Index n = problem_.variables;
  auto v = q_.row(size_);
  v = problem_.M.row(row);
  for (Index i = 0; i < size_; ++i) r_(i, size_) = 0.0L;
  for (int pass = 0; pass < 2; ++pass) {  // twice is enough (Kahan, Parlett)
    for (Index i = 0; i < size_; ++i) {
      long double sum = 0.0L;
      for (Index j = 0; j < n; ++j) sum += q_(i, j) * v(j);
      for (Index j = 0; j < n; ++j) v(j) -= sum * q_(i, j);
      r_(i, size_) += sum;
    }
  }
  const long double rest = v.norm();
  if (rest < kDependent) return false;
  v /= rest;
  r_(size_, size_) = rest;
  ++size_;
  return true;
}

bool RegionCertifier::depends(int row, std::vector<double>* coefficients) const {
  const Index n = problem_.variables;
  if (problem_.norms[index(row)] == 0.0L) {
    coefficients->assign(index(size_), 0.0);
    return true;
  }
  std::vector<long double> rest(index(n)), c(index(size_));
  for (Index j = 0; j < n; ++j) rest[index(j)] = problem_.M(row, j);
  for (int pass = 0; pass < 2; ++pass) {
    for (Index i = 0; i < size_; ++i) {
      long double sum = 0.0L;
      for (Index j = 0; j < n; ++j) sum += q_(i, j) * rest[index(j)];
      for (Index j = 0; j < n; ++j) rest[index(j)] -= sum * q_(i, j);
      c[index(i)] += sum;
    }
  }
  long double norm = 0.0L;
  for (const long double x : rest) norm += x * x;
  if (std::sqrt(norm) >= kDependent) return false;
  for (Index i = size_ - 1; i >= 0; --i) {
    for (Index k = i + 1; k < size_; ++k) c[index(i)] -= r_(i, k) * c[index(k)];
    c[index(i)] /= r_(i, i);
  }
  coefficients->assign(c.begin(), c.end());
  return true;
}

bool RegionCertifier::solve(const std::vector<int>& active, CertifiedRegion& region) {
  const Index n = problem_.variables;
  const Index np = problem_.parameters;
  region.active = active;
  region.independent.clear();
  region.solved = false;
  size_ = 0;
  std::vector<int> rows;
  for (const int row : active) {
    if (row < 0 || row >= problem_.rows) return false;
    rows.push_back(problem_.first_equal[index(row)]);
  }
  std::sort(rows.begin(), rows.end());
  for (const int row : rows) {
    if (append(row)) region.independent.push_back(row);
  }
  const Index k = size_;
  // y = R⁻ᵀ D_𝒜, z = Q y, λ = −R⁻¹ y.
  ExtendedMatrix y(k, np + 1), lambda(k, np + 1);
  for (Index i = 0; i < k; ++i) {
    for (Index c = 0; c <= np; ++c) {
      long double sum = problem_.D(region.independent[index(i)], c);
      for (Index j = 0; j < i; ++j) sum -= r_(j, i) * y(j, c);
      y(i, c) = sum / r_(i, i);
    }
  }
  for (Index i = k - 1; i >= 0; --i) {
    for (Index c = 0; c <= np; ++c) {
      long double sum = -y(i, c);
      for (Index j = i + 1; j < k; ++j) sum -= r_(i, j) * lambda(j, c);
      lambda(i, c) = sum / r_(i, i);
    }
  }
  ExtendedMatrix z = ExtendedMatrix::Zero(n, np + 1);
  for (Index i = 0; i < k; ++i) {
    for (Index j = 0; j < n; ++j) {
      const long double q = q_(i, j);
      for (Index c = 0; c <= np; ++c) z(j, c) += q * y(i, c);
    }
  }
  // U = L⁻ᵀ (z − L⁻¹ F), from here on with the data as given.
  ExtendedMatrix U = problem_.F;
  problem_.L.triangularView<Eigen::Lower>().solveInPlace(U);
  U = z - U;
  problem_.L.transpose().triangularView<Eigen::Upper>().solveInPlace(U);

  ExtendedMatrix gradient = problem_.F;
  ExtendedMatrix size = problem_.F.cwiseAbs();
  const auto add = [&](Index row, long double factor, const long double* form) {
    for (Index c = 0; c <= np; ++c) {
      gradient(row, c) += factor * form[c];
      size(row, c) += std::abs(factor * form[c]);
    }
  };
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) add(i, problem_.H(i, j), U.data() + j * (np + 1));
    for (Index a = 0; a < k; ++a) {
      const int row = region.independent[index(a)];
      add(i, problem_.G(row, i) / problem_.norms[index(row)], lambda.data() + a * (np + 1));
    }
  }
  long double largest = 0.0L;
  long double worst = 0.0L;
  for (Index i = 0; i < n; ++i) {
    largest = std::max(largest, size.row(i).sum());
    worst = std::max(worst, gradient.row(i).cwiseAbs().sum());
  }
  region.stationarity = static_cast<double>(largest > 0.0L ? worst / largest : 0.0L);

  worst = 0.0L;
  largest = 1e-300L;
  std::size_t next = 0;
  for (Index i = 0; i < problem_.rows; ++i) {
    const long double norm = problem_.norms[index(i)] > 0.0L ? problem_.norms[index(i)] : 1.0L;
    long double scale = 0.0L;
    for (Index c = 0; c <= np; ++c) {
      const long double* u = U.data() + c;
      const long double* g = problem_.G.data() + i * n;
      long double sum = 0.0L;
      long double terms = std::abs(problem_.W(i, c));
      for (Index j = 0; j < n; ++j) {
        const long double term = g[j] * u[j * (np + 1)];
        sum += term;
        terms += std::abs(term);
      }
      forms_(i, c) = (problem_.W(i, c) - sum) / norm;
      scale = std::max(scale, terms / norm);
    }
    largest = std::max(largest, scale);
    if (next < region.independent.size() && region.independent[next] == i) {
      const Index a = static_cast<Index>(next++);
      worst = std::max(worst, forms_.row(i).cwiseAbs().sum());
      forms_.row(i) = lambda.row(a);
      scale = forms_.row(i).cwiseAbs().maxCoeff();
    }
    scales_[index(i)] = scale;
  }
  region.primal = static_cast<double>(worst / largest);
  region.z.assign(z.data(), z.data() + z.size());
  region.lambda.assign(lambda.data(), lambda.data() + lambda.size());
  for (Index c = 0; c <= np; ++c) {
    long double sum = problem_.Y(0, c);
    for (Index j = 0; j < n; ++j) sum += problem_.Y_U(0, j) * U(j, c);
    output_[index(c)] = sum;
    region.output[index(c)] = static_cast<double>(sum);
  }
  return true;
}

AffineForm RegionCertifier::slack(const CertifiedRegion& region, int row) const {
  const Index np = problem_.parameters;
  AffineForm form{};
  for (Index c = 0; c <= np; ++c) {
    long double sum = problem_.D(row, c);
    for (Index j = 0; j < problem_.variables; ++j) {
      sum -= problem_.M(row, j) * region.z[index(j * (np + 1) + c)];
    }
    form[index(c)] = static_cast<double>(sum);
  }
  return form;
}

bool RegionCertifier::certify(const std::vector<int>& active, double least_radius,
                              CertifiedRegion& region) {
  region.polytope.radius = -1.0;
  if (!solve(active, region)) return false;
  const Index np = problem_.parameters;
  rows_.clear();
  labels_.clear();
  for (Index i = 0; i < problem_.rows; ++i) {
    if (problem_.first_equal[index(i)] != static_cast<int>(i)) continue;
    const auto form = forms_.row(i);
    const long double norm = form.head(np).norm();
    const long double scale = scales_[index(i)];
    if (norm <= kConstant * scale) {
      if (form(np) < -kSign * scale) return false;
      continue;
    }
    Point normal{};
    for (Index j = 0; j < np; ++j) normal[index(j)] = static_cast<double>(-form(j) / norm);
    rows_.append(normal.data(), static_cast<double>(form(np) / norm));
    labels_.push_back(static_cast<int>(i));
  }
  region.solved = maker_.make(rows_, labels_, least_radius, region.polytope);
  if (region.solved) mark_coincident(region);
  return region.solved;
}

void RegionCertifier::mark_coincident(CertifiedRegion& region) const {
  const HalfSpaces& facets = region.polytope.facets;
  const int np = problem_.parameters;
  region.coincident.assign(index(facets.size()), 0);
  for (int f = 0; f < facets.size(); ++f) {
    for (int i = 0; i < rows_.size(); ++i) {
      if (labels_[index(i)] == region.polytope.labels[index(f)]) continue;
      double apart = std::abs(rows_.offset(i) - facets.offset(f));
      for (int j = 0; j < np && apart <= CertifiedRegion::kSamePlane; ++j) {
        apart = std::max(apart, std::abs(rows_.normal(i, j) - facets.normal(f, j)));
      }
      if (apart <= CertifiedRegion::kSamePlane) region.coincident[index(f)] = 1;
    }
  }
}

RegionsCertificate certify_regions(const CertificateProblem& problem,
                                   const std::vector<std::vector<int>>& active_sets, int threads,
                                   const LoopProgress& progress) {
  RegionsCertificate result;
  const int count = static_cast<int>(active_sets.size());
  result.regions.resize(active_sets.size());
  std::vector<std::unique_ptr<RegionCertifier>> certifiers;
  for (int t = 0; t < threads; ++t) {
    certifiers.push_back(std::make_unique<RegionCertifier>(problem));
  }
  parallel_range(
      count, threads,
      [&](int i, int thread) {
        std::vector<int> active = active_sets[index(i)];
        std::sort(active.begin(), active.end());
        certifiers[index(thread)]->certify(active, 1e-12, result.regions[index(i)]);
      },
      progress);
  result.least_radius = 2.0;
  for (int i = 0; i < count; ++i) {
    const CertifiedRegion& region = result.regions[index(i)];
    if (!region.solved) {
      if (result.empty++ == 0) result.first_empty = i;
      continue;
    }
    result.stationarity = std::max(result.stationarity, region.stationarity);
    result.primal = std::max(result.primal, region.primal);
    result.least_radius = std::min(result.least_radius, region.polytope.radius);
    if (region.polytope.radius < 1e-8) ++result.flat;
  }
  for (const auto& certifier : certifiers) result.lps += certifier->lp_count();
  return result;
}

}  // namespace eampc::law_design
