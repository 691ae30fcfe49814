// Least-distance quadratic program: min ½‖z‖² subject to M z ≤ d, rows of M of unit norm.
//
// The dual active-set method of Goldfarb and Idnani (Math. Programming 27, 1983), from any warm
// start. Every strictly convex QP takes this form by z = Lᵀu + L⁻¹f, H = L Lᵀ.
#pragma once

#include <Eigen/Dense>
#include <span>
#include <vector>

namespace eampc::law_design {

/// Thin QR factorisation of the transposed active rows, updated row by row.
class ActiveRows {
 public:
  /// Distance of a unit row from the span of the others below which it counts as dependent.
  static constexpr double kDependent = 1e-8;

  explicit ActiveRows(int dimension)
      : q_(dimension, dimension), r_(dimension, dimension), work_(dimension) {}

  int size() const { return size_; }
  void clear() { size_ = 0; }
  /// Column i of Q, and an entry of R.
  const double* direction(int i) const { return q_.data() + i * q_.rows(); }
  double r(int row, int column) const { return r_(row, column); }
  /// Least diagonal entry of R, at most 1: one over it estimates the condition of unit rows.
  double least_pivot() const;

  /// Adds a unit row. False (and nothing added) if it depends on the rows already there.
  bool append(const double* row);
  /// Removes row `position`; later rows move up by one.
  void remove(int position);

  /// R⁻¹ Qᵀ v: coefficients of v in the active rows (v projected onto their span).
  void coefficients(const double* v, double* result) const;
  /// Distance of a row from the span of the active rows; `remainder` is the part outside it.
  double split(const double* row, double* remainder) const;
  /// The point z of least norm with M_𝒜 z = d, and λ with z = −M_𝒜ᵀ λ.
  void least_norm(const double* d, double* z, double* lambda) const;

 private:
  Eigen::MatrixXd q_, r_;
  mutable Eigen::VectorXd work_;
  int size_ = 0;
};

enum class QpStatus { kOptimal, kInfeasible, kFailed };

class LeastDistanceProgram {
 public:
  /// `rows` is m×n, row-major, unit rows; it must outlive the solver. `tolerances` (m) are the
  /// violations of M z ≤ d that count as none.
  using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  LeastDistanceProgram(const RowMatrix& rows, std::span<const double> tolerances);

  /// Solves for the right side d (m numbers). `active` is the warm start on entry, the linearly
  /// independent active set (ascending) on exit.
  QpStatus solve(const double* d, std::vector<int>& active);

  const double* z() const { return z_.data(); }
  long count() const { return count_; }

 private:
  void restart(const double* d, std::span<const int> warm);
  void resolve(const double* d);

  const RowMatrix& rows_;
  std::span<const double> tolerances_;
  ActiveRows factor_;
  std::vector<int> active_;
  std::vector<double> lambda_, coefficients_, active_d_, z_, remainder_;
  std::vector<char> is_active_;
  long count_ = 0;
};

}  // namespace eampc::law_design
