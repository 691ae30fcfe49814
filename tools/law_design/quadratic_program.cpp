#include "law_design/quadratic_program.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace eampc::law_design {
namespace {

// A remainder this long, of a unit row, is orthogonal to rounding after one pass.
constexpr double kLittleCancelled = 0.1;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

double dot(const double* a, const double* b, Eigen::Index n) {
  // Two independent sums, which is what a register of two doubles holds.
  double even = 0.0;
  double odd = 0.0;
  Eigen::Index j = 0;
  for (; j + 1 < n; j += 2) {
    even += a[j] * b[j];
    odd += a[j + 1] * b[j + 1];
  }
  if (j < n) even += a[j] * b[j];
  return even + odd;
}

}  // namespace

bool ActiveRows::append(const double* row) {
  const Eigen::Index n = q_.rows();
  const Eigen::Index k = size_;
  if (k == n) return false;
  double* v = q_.data() + k * n;  // the column being made
  double* r = r_.data() + k * n;
  std::copy(row, row + n, v);
  std::fill(r, r + k + 1, 0.0);
  double norm = 1.0;
  for (int pass = 0; pass < 2; ++pass) {  // twice is enough (Kahan), once if little cancels
    for (Eigen::Index i = 0; i < k; ++i) {
      const double* q = q_.data() + i * n;
      const double h = dot(q, v, n);
      r[i] += h;
      for (Eigen::Index j = 0; j < n; ++j) v[j] -= h * q[j];
    }
    norm = std::sqrt(dot(v, v, n));
    if (norm > kLittleCancelled) break;
  }
  if (norm < kDependent) return false;
  for (Eigen::Index j = 0; j < n; ++j) v[j] /= norm;
  r[k] = norm;
  ++size_;
  return true;
}

void ActiveRows::remove(int position) {
  const Eigen::Index n = q_.rows();
  for (Eigen::Index c = position; c + 1 < size_; ++c) {
    r_.col(c).head(c + 2) = r_.col(c + 1).head(c + 2);
  }
  --size_;
  for (Eigen::Index c = position; c < size_; ++c) {
    const double a = r_(c, c);
    const double b = r_(c + 1, c);
    const double h = std::hypot(a, b);
    const double cosine = h > 0.0 ? a / h : 1.0;
    const double sine = h > 0.0 ? b / h : 0.0;
    for (Eigen::Index l = c; l < size_; ++l) {
      const double top = r_(c, l);
      const double bottom = r_(c + 1, l);
      r_(c, l) = cosine * top + sine * bottom;
      r_(c + 1, l) = -sine * top + cosine * bottom;
    }
    for (Eigen::Index j = 0; j < n; ++j) {
      const double left = q_(j, c);
      const double right = q_(j, c + 1);
      q_(j, c) = cosine * left + sine * right;
      q_(j, c + 1) = -sine * left + cosine * right;
    }
  }
}

void ActiveRows::coefficients(const double* v, double* result) const {
  const Eigen::Index n = q_.rows();
  for (Eigen::Index i = size_ - 1; i >= 0; --i) {
    double sum = dot(q_.data() + i * n, v, n);
    for (Eigen::Index l = i + 1; l < size_; ++l) sum -= r_(i, l) * result[l];
    result[i] = sum / r_(i, i);
  }
}

double ActiveRows::split(const double* row, double* remainder) const {
  const Eigen::Index n = q_.rows();
  std::copy(row, row + n, remainder);
  double norm = 1.0;
  for (int pass = 0; pass < 2; ++pass) {
    for (Eigen::Index i = 0; i < size_; ++i) {
      const double* q = q_.data() + i * n;
      const double h = dot(q, remainder, n);
      for (Eigen::Index j = 0; j < n; ++j) remainder[j] -= h * q[j];
    }
    norm = std::sqrt(dot(remainder, remainder, n));
    if (norm > kLittleCancelled) break;
  }
  return norm;
}

double ActiveRows::least_pivot() const {
  double least = 1.0;
  for (Eigen::Index i = 0; i < size_; ++i) least = std::min(least, std::abs(r_(i, i)));
  return least;
}

void ActiveRows::least_norm(const double* d, double* z, double* lambda) const {
  const Eigen::Index n = q_.rows();
  double* w = work_.data();
  std::fill(z, z + n, 0.0);
  for (Eigen::Index i = 0; i < size_; ++i) {  // Rᵀ w = d
    double sum = d[i];
    for (Eigen::Index l = 0; l < i; ++l) sum -= r_(l, i) * w[l];
    w[i] = sum / r_(i, i);
    const double* q = q_.data() + i * n;
    for (Eigen::Index j = 0; j < n; ++j) z[j] += w[i] * q[j];
  }
  for (Eigen::Index i = size_ - 1; i >= 0; --i) {  // R λ = −w
    double sum = -w[i];
    for (Eigen::Index l = i + 1; l < size_; ++l) sum -= r_(i, l) * lambda[l];
    lambda[i] = sum / r_(i, i);
  }
}

LeastDistanceProgram::LeastDistanceProgram(const RowMatrix& rows,
                                           std::span<const double> tolerances)
    : rows_(rows),
      tolerances_(tolerances),
      factor_(static_cast<int>(rows.cols())),
      lambda_(static_cast<std::size_t>(rows.cols() + 1)),
      coefficients_(static_cast<std::size_t>(rows.cols() + 1)),
      active_d_(static_cast<std::size_t>(rows.cols() + 1)),
      z_(static_cast<std::size_t>(rows.cols())),
      remainder_(static_cast<std::size_t>(rows.cols())),
      is_active_(static_cast<std::size_t>(rows.rows()), 0) {}

void LeastDistanceProgram::resolve(const double* d) {
  for (std::size_t i = 0; i < active_.size(); ++i) active_d_[i] = d[active_[i]];
  factor_.least_norm(active_d_.data(), z_.data(), lambda_.data());
}

void LeastDistanceProgram::restart(const double* d, std::span<const int> warm) {
  factor_.clear();
  active_.clear();
  std::fill(is_active_.begin(), is_active_.end(), char{0});
  for (const int row : warm) {
    if (factor_.append(rows_.row(row).data())) {
      active_.push_back(row);
      is_active_[index(row)] = 1;
    }
  }
  while (true) {
    resolve(d);
    int worst = -1;
    double least = 0.0;
    for (std::size_t i = 0; i < active_.size(); ++i) {
      if (lambda_[i] < least) {
        least = lambda_[i];
        worst = static_cast<int>(i);
      }
    }
    if (worst < 0) return;
    is_active_[index(active_[index(worst)])] = 0;
    factor_.remove(worst);
    active_.erase(active_.begin() + worst);
  }
}

QpStatus LeastDistanceProgram::solve(const double* d, std::vector<int>& active) {
  ++count_;
  const int m = static_cast<int>(rows_.rows());
  const Eigen::Index n = rows_.cols();
  restart(d, active);
  const auto drop = [&](int position) {
    is_active_[index(active_[index(position)])] = 0;
    factor_.remove(position);
    active_.erase(active_.begin() + position);
    lambda_.erase(lambda_.begin() + position);
    lambda_.push_back(0.0);
  };
  const int limit = 20 * (m + static_cast<int>(n));
  int steps = 0;
  while (steps < limit) {
    int entering = -1;
    double violation = 0.0;
    for (int i = 0; i < m; ++i) {
      if (is_active_[index(i)]) continue;
      const double excess = dot(rows_.data() + i * n, z_.data(), n) - d[i];
      if (excess - tolerances_[index(i)] > violation) {
        violation = excess - tolerances_[index(i)];
        entering = i;
      }
    }
    if (entering < 0) {
      // Multipliers that vanish are not part of a critical region's active set.
      active = active_;
      std::sort(active.begin(), active.end());
      return QpStatus::kOptimal;
    }
    const double* row = rows_.data() + entering * n;
    double entering_lambda = 0.0;
    while (true) {
      if (++steps > limit) return QpStatus::kFailed;
      const double distance = factor_.split(row, remainder_.data());
      factor_.coefficients(row, coefficients_.data());
      double partial = std::numeric_limits<double>::infinity();
      int leaving = -1;
      for (std::size_t i = 0; i < active_.size(); ++i) {
        if (coefficients_[i] <= 1e-12) continue;
        const double t = lambda_[i] / coefficients_[i];
        if (t < partial) {
          partial = t;
          leaving = static_cast<int>(i);
        }
      }
      const bool dependent = distance < ActiveRows::kDependent;
      const double excess = dot(row, z_.data(), n) - d[entering];
      const double full = dependent ? std::numeric_limits<double>::infinity()
                                    : std::max(excess, 0.0) / (distance * distance);
      if (dependent && leaving < 0) return QpStatus::kInfeasible;
      const double t = std::min(partial, full);
      for (std::size_t i = 0; i < active_.size(); ++i) {
        lambda_[i] = std::max(lambda_[i] - t * coefficients_[i], 0.0);
      }
      entering_lambda += t;
      if (full <= partial) {
        if (!factor_.append(row)) return QpStatus::kFailed;
        active_.push_back(entering);
        is_active_[index(entering)] = 1;
        resolve(d);
        break;
      }
      if (!dependent) {
        for (Eigen::Index j = 0; j < n; ++j) {
          z_[static_cast<std::size_t>(j)] -= t * remainder_[static_cast<std::size_t>(j)];
        }
      }
      drop(leaving);
    }
    // Rounding of the exact multipliers below zero: drop the worst and go on.
    for (std::size_t i = 0; i < active_.size();) {
      if (lambda_[i] < 0.0 && ++steps < limit) {
        drop(static_cast<int>(i));
        resolve(d);
        i = 0;
      } else {
        ++i;
      }
    }
  }
  return QpStatus::kFailed;
}

}  // namespace eampc::law_design
