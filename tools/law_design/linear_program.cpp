#include "law_design/linear_program.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "law_design/extended_program.hpp"

namespace eampc::law_design {
namespace {

// Coefficients below this cannot leave the basis: pivoting on them would lose nine digits.
constexpr double kPivot = 1e-10;
// Multipliers may slip below zero by this much before they are set to zero: a change of c far below
// every tolerance used on the objective (1e-10 and more).
constexpr double kSlip = 1e-13;
// Of sums of up to dimension + 2 products, of their size, per dimension: 2 ε.
constexpr double kRounding = 4.5e-16;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

LinearProgram::LinearProgram(int dimension)
    : dimension_(dimension),
      lower_(index(dimension), -1.0),
      upper_(index(dimension), 1.0),
      c_(index(dimension)),
      x_(index(dimension)),
      multipliers_(index(dimension)),
      inverse_(index(dimension * dimension)),
      entering_(index(dimension)),
      alpha_(index(dimension)),
      row_(index(dimension)),
      sum_(index(dimension)),
      basis_rows_(index(dimension)) {}

void LinearProgram::set_bounds(int j, double lower, double upper) {
  lower_[index(j)] = lower;
  upper_[index(j)] = upper;
}

LpResult LinearProgram::maximise(const double* c, std::span<const HalfSpaces* const> parts,
                                 double cutoff) {
  ++count_;
  for (int j = 0; j < dimension_; ++j) {
    // A fixed irregular sequence: no two coordinates get the same ratio.
    const double jitter = 0.5 + std::fmod(0.6180339887498949 * (j + 1), 1.0);
    c_[index(j)] = c[j] + (c[j] < 0.0 ? -perturbation_ : perturbation_) * jitter;
  }
  const LpResult result = solve_quickly(parts, cutoff);
  if (result.status != LpStatus::kFailed) return result;
  ++careful_count_;
  return solve_carefully(parts, cutoff);
}

// The whole program once more in extended precision.
LpResult LinearProgram::solve_carefully(std::span<const HalfSpaces* const> parts, double cutoff) {
  ExtendedProgram program(dimension_);
  program.set_tolerance(tolerance_);
  for (int j = 0; j < dimension_; ++j) program.set_bounds(j, lower_[index(j)], upper_[index(j)]);
  for (const HalfSpaces* part : parts) {
    for (int i = 0; i < part->size(); ++i) {
      part->copy_normal(i, row_.data());
      program.append(row_.data(), part->offset(i));
    }
  }
  const std::vector<long double> c(c_.begin(), c_.end());
  const LpResult result = program.maximise(c.data(), cutoff);
  std::copy_n(program.point(), dimension_, x_.begin());
  std::copy(program.basis().begin(), program.basis().end(), basis_rows_.begin());
  return result;
}

LpResult LinearProgram::solve_quickly(std::span<const HalfSpaces* const> parts, double cutoff) {
  int rows = 0;
  for (const HalfSpaces* part : parts) rows = std::max(rows, part->size());
  if (excess_.size() < index(rows)) excess_.resize(index(2 * rows));
  switch (dimension_) {
    case 2:
      return solve<2>(parts, cutoff);
    case 3:
      return solve<3>(parts, cutoff);
    case 4:
      return solve<4>(parts, cutoff);
    case 5:
      return solve<5>(parts, cutoff);
    case 6:
      return solve<6>(parts, cutoff);
    case 7:
      return solve<7>(parts, cutoff);
    case 8:
      return solve<8>(parts, cutoff);
    default:
      return solve<0>(parts, cutoff);
  }
}

template <int N>
LinearProgram::Entering LinearProgram::most_violated(std::span<const HalfSpaces* const> parts) {
  const int n = N > 0 ? N : dimension_;
  Entering worst;
  worst.violation = tolerance_;
  int first = 0;
  double* excess = excess_.data();
  for (const HalfSpaces* part : parts) {
    const int m = part->size();
    const double* b = part->offsets();
    if constexpr (N > 0) {
      const double* column[static_cast<std::size_t>(N > 0 ? N : 1)];
      double x[static_cast<std::size_t>(N > 0 ? N : 1)];
      for (int j = 0; j < N; ++j) {
        column[j] = part->column(j);
        x[j] = x_[index(j)];
      }
      for (int i = 0; i < m; ++i) {
        double sum = -b[i];
        for (int j = 0; j < N; ++j) sum += column[j][i] * x[j];
        excess[i] = sum;
      }
    } else {
      part->excess(x_.data(), excess);
    }
    for (int i = 0; i < m; ++i) {
      if (excess[i] > worst.violation) worst = {first + i, excess[i]};
    }
    first += m;
  }
  for (int j = 0; j < n; ++j) {
    const double x = x_[index(j)];
    if (x - upper_[index(j)] > worst.violation) worst = {first + 2 * j, x - upper_[index(j)]};
    if (lower_[index(j)] - x > worst.violation) worst = {first + 2 * j + 1, lower_[index(j)] - x};
  }
  return worst;
}

void LinearProgram::load_row(std::span<const HalfSpaces* const> parts, int row, double* a,
                             double* b) const {
  for (const HalfSpaces* part : parts) {
    if (row < part->size()) {
      part->copy_normal(row, a);
      *b = part->offset(row);
      return;
    }
    row -= part->size();
  }
  std::fill(a, a + dimension_, 0.0);
  const int j = row / 2;
  a[j] = row % 2 == 0 ? 1.0 : -1.0;
  *b = row % 2 == 0 ? upper_[index(j)] : -lower_[index(j)];
}

bool LinearProgram::refactorise(std::span<const HalfSpaces* const> parts) {
  const int n = dimension_;
  Eigen::MatrixXd basis(n, n);
  Eigen::VectorXd b(n);
  std::vector<double> a(index(n));
  for (int k = 0; k < n; ++k) {
    load_row(parts, basis_rows_[index(k)], a.data(), &b(k));
    for (int j = 0; j < n; ++j) basis(k, j) = a[index(j)];
  }
  const Eigen::PartialPivLU<Eigen::MatrixXd> factor(basis);
  const Eigen::MatrixXd inverse = factor.inverse();
  if (!inverse.allFinite()) return false;
  Eigen::Map<Eigen::MatrixXd>(inverse_.data(), n, n) = inverse;
  Eigen::Map<Eigen::VectorXd>(x_.data(), n) = factor.solve(b);
  const Eigen::Map<const Eigen::VectorXd> c(c_.data(), n);
  for (int k = 0; k < n; ++k) {
    const double y = c.dot(inverse.col(k));
    if (y < -1e-11) return false;
    multipliers_[index(k)] = std::max(y, 0.0);
  }
  return true;
}

double LinearProgram::reach(int j) const {
  return std::max(std::abs(lower_[index(j)]), std::abs(upper_[index(j)]));
}

// Weak duality with the multipliers as they are, which are not negative.
double LinearProgram::dual_bound(std::span<const HalfSpaces* const> parts) {
  const int n = dimension_;
  std::copy(c_.begin(), c_.end(), sum_.begin());
  double bound = 0.0;
  double size = 0.0;
  for (int k = 0; k < n; ++k) {
    const double y = multipliers_[index(k)];
    if (y == 0.0) continue;
    double b = 0.0;
    load_row(parts, basis_rows_[index(k)], row_.data(), &b);
    bound += y * b;
    size += y * std::abs(b);
    for (int j = 0; j < n; ++j) {
      sum_[index(j)] -= y * row_[index(j)];
      size += y * std::abs(row_[index(j)]) * reach(j);
    }
  }
  for (int j = 0; j < n; ++j) bound += std::abs(sum_[index(j)]) * reach(j);
  return bound + kRounding * n * size;
}

// Farkas' lemma with the entering row a·x ≤ b and the rows of the basis that make it up (alpha).
bool LinearProgram::contradict(std::span<const HalfSpaces* const> parts, double b) {
  const int n = dimension_;
  std::copy(entering_.begin(), entering_.end(), sum_.begin());
  double sum = b;
  double size = std::abs(b);
  for (int j = 0; j < n; ++j) size += std::abs(entering_[index(j)]) * reach(j);
  for (int k = 0; k < n; ++k) {
    const double mu = -alpha_[index(k)];
    if (mu <= 0.0) continue;
    double offset = 0.0;
    load_row(parts, basis_rows_[index(k)], row_.data(), &offset);
    sum += mu * offset;
    size += mu * std::abs(offset);
    for (int j = 0; j < n; ++j) {
      sum_[index(j)] += mu * row_[index(j)];
      size += mu * std::abs(row_[index(j)]) * reach(j);
    }
  }
  for (int j = 0; j < n; ++j) sum += std::abs(sum_[index(j)]) * reach(j);
  return sum + kRounding * n * size < 0.0;
}

template <int N>
LpResult LinearProgram::solve(std::span<const HalfSpaces* const> parts, double cutoff) {
  const int n = N > 0 ? N : dimension_;
  int rows = 0;
  for (const HalfSpaces* part : parts) rows += part->size();
  std::fill(inverse_.begin(), inverse_.end(), 0.0);
  double* inverse = inverse_.data();
  double* x = x_.data();
  double* y = multipliers_.data();
  double* alpha = alpha_.data();
  double* a = entering_.data();
  const double* c = c_.data();
  for (int j = 0; j < n; ++j) {
    const bool up = c[j] >= 0.0;
    inverse[j * n + j] = up ? 1.0 : -1.0;
    x[j] = up ? upper_[index(j)] : lower_[index(j)];
    y[j] = std::abs(c[j]);
    basis_rows_[index(j)] = rows + 2 * j + (up ? 0 : 1);
  }
  const int limit = 50 + 20 * n;
  bool fresh = true;
  int restarts = 0;
  for (int iteration = 0; iteration < limit; ++iteration) {
    double value = 0.0;
    for (int j = 0; j < n; ++j) value += c[j] * x[j];
    if (value <= cutoff) {
      if (iteration == 0) return {LpStatus::kBelowCutoff, value};  // the corner of the box
      const double bound = dual_bound(parts);
      if (bound <= cutoff) return {LpStatus::kBelowCutoff, bound};
    }
    const Entering entering = most_violated<N>(parts);
    bool inside_basis = false;
    for (int k = 0; k < n; ++k) inside_basis |= basis_rows_[index(k)] == entering.row;
    if (entering.row < 0 || inside_basis) {
      // Accept only what a fresh factorisation would give too: rows of the basis tight, c in
      // their cone.
      double worst = inside_basis ? 1.0 : 0.0;
      for (int j = 0; j < n; ++j) alpha[j] = c[j];
      for (int k = 0; k < n && !inside_basis; ++k) {
        double b = 0.0;
        load_row(parts, basis_rows_[index(k)], a, &b);
        for (int j = 0; j < n; ++j) {
          b -= a[j] * x[j];
          alpha[j] -= y[k] * a[j];
        }
        worst = std::max(worst, std::abs(b));
      }
      for (int j = 0; j < n; ++j) worst = std::max(worst, std::abs(alpha[j]));
      if (worst < tolerance_ || (fresh && !inside_basis)) {
        return {LpStatus::kOptimal, dual_bound(parts)};
      }
      if (++restarts > 3 || fresh || !refactorise(parts)) break;
      fresh = true;
      continue;
    }
    double b = 0.0;
    load_row(parts, entering.row, a, &b);
    // Harris' ratio test: among the multipliers that vanish within kSlip of the first, the one
    // with the largest pivot leaves.
    double reach = std::numeric_limits<double>::infinity();
    for (int k = 0; k < n; ++k) {
      double sum = 0.0;
      for (int j = 0; j < n; ++j) sum += a[j] * inverse[k * n + j];
      alpha[k] = sum;
      if (sum > kPivot) reach = std::min(reach, (y[k] + kSlip) / sum);
    }
    int leaving = -1;
    for (int k = 0; k < n; ++k) {
      if (alpha[k] > kPivot && y[k] <= reach * alpha[k] &&
          (leaving < 0 || alpha[k] > alpha[leaving])) {
        leaving = k;
      }
    }
    const double ratio = leaving < 0 ? 0.0 : y[leaving] / alpha[leaving];
    if (leaving < 0) {
      if (contradict(parts, b)) return {LpStatus::kInfeasible, value};
      if (fresh || ++restarts > 3 || !refactorise(parts)) break;
      fresh = true;
      continue;
    }
    fresh = false;
    const double pivot = alpha[leaving];
    double* column = inverse + leaving * n;
    for (int j = 0; j < n; ++j) column[j] /= pivot;
    for (int j = 0; j < n; ++j) x[j] -= entering.violation * column[j];
    for (int k = 0; k < n; ++k) {
      if (k == leaving) continue;
      const double factor = alpha[k];
      y[k] = std::max(y[k] - ratio * factor, 0.0);
      for (int j = 0; j < n; ++j) inverse[k * n + j] -= factor * column[j];
    }
    y[leaving] = ratio;
    basis_rows_[index(leaving)] = entering.row;
  }
  return {LpStatus::kFailed, std::numeric_limits<double>::infinity()};
}

}  // namespace eampc::law_design
