#include "law_design/extended_program.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace eampc::law_design {
namespace {

// Share of the entering row, of the largest, in a row that may leave the basis, at best …
constexpr long double kPivot = 1e-11L;
// … and where nothing else helps.
constexpr long double kLeastPivot = 1e-16L;
// Irregular changes of c, of its size, that break ties; what they hide is added to the bound. The
// larger ones lead around a basis that cannot be inverted.
constexpr long double kJitters[] = {1e-17L, 1e-14L, 1e-12L};
// Multipliers may slip below zero by this, of the size of c; added to the bound too.
constexpr long double kSlip = 1e-18L;
// Of sums of up to dimension + 2 products, of their size, per dimension: 2 ε.
constexpr long double kRounding = 2.2e-19L;
// After so many vertices the first violated row enters, and the first of equals leaves: that rule
// does not cycle.
constexpr int kFirst = 100;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

ExtendedProgram::ExtendedProgram(int dimension)
    : dimension_(dimension),
      lower_(index(dimension), -1.0L),
      upper_(index(dimension), 1.0L),
      reach_(index(dimension), 1.0L),
      c_(index(dimension)),
      x_(index(dimension)),
      y_(index(dimension)),
      alpha_(index(dimension)),
      side_(index(dimension)),
      sum_(index(dimension)),
      matrix_(index(dimension * dimension)),
      inverse_(index(dimension * dimension)),
      basis_(index(dimension)) {}

void ExtendedProgram::set_bounds(int j, double lower, double upper) {
  lower_[index(j)] = lower;
  upper_[index(j)] = upper;
  reach_[index(j)] = std::max(std::abs(lower), std::abs(upper));
}

// The normal of a row; those of the bounds stand in side_ until the next call.
const long double* ExtendedProgram::row(int i, long double* b) {
  if (i < rows()) {
    *b = offsets_[index(i)];
    return normals_.data() + index(i) * index(dimension_);
  }
  const int j = (i - rows()) / 2;
  const bool up = (i - rows()) % 2 == 0;
  std::fill(side_.begin(), side_.end(), 0.0L);
  side_[index(j)] = up ? 1.0L : -1.0L;
  *b = up ? upper_[index(j)] : -lower_[index(j)];
  return side_.data();
}

// Of the basis, by Gauss and Jordan with row pivots: matrix_ keeps the basis.
bool ExtendedProgram::invert() {
  const int n = dimension_;
  long double b = 0.0L;
  Numbers& work = sum_;
  work.assign(index(n * n), 0.0L);
  std::fill(inverse_.begin(), inverse_.end(), 0.0L);
  for (int k = 0; k < n; ++k) {
    std::copy_n(row(basis_[index(k)], &b), n, work.begin() + k * n);
    inverse_[index(k * n + k)] = 1.0L;
  }
  matrix_ = work;
  for (int c = 0; c < n; ++c) {
    int pivot = c;
    for (int r = c + 1; r < n; ++r) {
      if (std::abs(work[index(r * n + c)]) > std::abs(work[index(pivot * n + c)])) pivot = r;
    }
    if (std::abs(work[index(pivot * n + c)]) < 1e-17L) return false;
    if (pivot != c) {
      std::swap_ranges(work.begin() + c * n, work.begin() + (c + 1) * n, work.begin() + pivot * n);
      std::swap_ranges(inverse_.begin() + c * n, inverse_.begin() + (c + 1) * n,
                       inverse_.begin() + pivot * n);
    }
    const long double scale = 1.0L / work[index(c * n + c)];
    for (int j = 0; j < n; ++j) {
      work[index(c * n + j)] *= scale;
      inverse_[index(c * n + j)] *= scale;
    }
    for (int r = 0; r < n; ++r) {
      const long double factor = work[index(r * n + c)];
      if (r == c || factor == 0.0L) continue;
      for (int j = 0; j < n; ++j) {
        work[index(r * n + j)] -= factor * work[index(c * n + j)];
        inverse_[index(r * n + j)] -= factor * inverse_[index(c * n + j)];
      }
    }
  }
  return true;
}

// What share of each row of the basis makes up a, refined so that it does to rounding however
// nearly parallel the rows are.
void ExtendedProgram::make_up(const long double* a, Numbers& shares) {
  const int n = dimension_;
  sum_.assign(a, a + n);
  std::fill(shares.begin(), shares.end(), 0.0L);
  for (int pass = 0; pass < 3; ++pass) {
    for (int k = 0; k < n; ++k) {
      for (int j = 0; j < n; ++j) {
        shares[index(k)] += sum_[index(j)] * inverse_[index(j * n + k)];
      }
    }
    if (pass == 2) break;
    sum_.assign(a, a + n);
    for (int k = 0; k < n; ++k) {
      for (int j = 0; j < n; ++j) {
        sum_[index(j)] -= shares[index(k)] * matrix_[index(k * n + j)];
      }
    }
  }
}

// x where the rows of the basis are tight, refined likewise; y, the multipliers of c.
void ExtendedProgram::step_to_vertex() {
  const int n = dimension_;
  std::fill(x_.begin(), x_.end(), 0.0L);
  for (int pass = 0; pass < 3; ++pass) {
    alpha_ = x_;
    for (int k = 0; k < n; ++k) {
      long double rest = 0.0L;
      const long double* a = row(basis_[index(k)], &rest);
      for (int j = 0; j < n; ++j) rest -= a[j] * x_[index(j)];
      for (int j = 0; j < n; ++j) alpha_[index(j)] += inverse_[index(j * n + k)] * rest;
    }
    x_ = alpha_;
  }
  make_up(c_.data(), y_);
}

// Weak duality with what is positive of y.
long double ExtendedProgram::dual_bound(const long double* c) {
  const int n = dimension_;
  sum_.assign(c, c + n);
  long double bound = 0.0L;
  long double size = 0.0L;
  for (int k = 0; k < n; ++k) {
    const long double y = y_[index(k)];
    if (y <= 0.0L) continue;
    long double b = 0.0L;
    const long double* a = row(basis_[index(k)], &b);
    bound += y * b;
    size += y * std::abs(b);
    for (int j = 0; j < n; ++j) {
      sum_[index(j)] -= y * a[j];
      size += y * std::abs(a[j]) * reach_[index(j)];
    }
  }
  for (int j = 0; j < n; ++j) bound += std::abs(sum_[index(j)]) * reach_[index(j)];
  return bound + kRounding * static_cast<long double>(n) * size;
}

int ExtendedProgram::most_violated(bool first) {
  int entering = -1;
  long double violation = tolerance_;
  for (int i = 0; i < rows() + 2 * dimension_; ++i) {
    if (std::find(basis_.begin(), basis_.end(), i) != basis_.end()) continue;
    long double b = 0.0L;
    const long double* a = row(i, &b);
    long double excess = -b;
    for (int j = 0; j < dimension_; ++j) excess += a[j] * x_[index(j)];
    if (excess <= violation) continue;
    entering = i;
    violation = excess;
    if (first) break;
  }
  return entering;
}

// The position in the basis that the entering row leaves by, -1 if no share of it (alpha_) exceeds
// `pivot` of the largest. Among the multipliers that vanish within kSlip of the first, the one with
// the largest share (Harris).
int ExtendedProgram::leaving(long double pivot, bool first) const {
  const int n = dimension_;
  long double largest = 1.0L;
  for (const long double share : alpha_) largest = std::max(largest, std::abs(share));
  const long double slip = first ? 0.0L : kSlip;
  long double reach = std::numeric_limits<long double>::infinity();
  for (int k = 0; k < n; ++k) {
    if (alpha_[index(k)] <= pivot * largest) continue;
    reach = std::min(reach, (std::max(y_[index(k)], 0.0L) + slip) / alpha_[index(k)]);
  }
  int position = -1;
  for (int k = 0; k < n; ++k) {
    if (alpha_[index(k)] <= pivot * largest || y_[index(k)] > reach * alpha_[index(k)]) continue;
    const bool better = position < 0 || (first ? basis_[index(k)] < basis_[index(position)]
                                               : alpha_[index(k)] > alpha_[index(position)]);
    if (better) position = k;
  }
  return position;
}

// Farkas' lemma with the entering row and the rows of the basis that make it up (alpha_).
bool ExtendedProgram::contradict(int entering) {
  const int n = dimension_;
  long double sum = 0.0L;
  const long double* a = row(entering, &sum);
  long double size = std::abs(sum);
  sum_.assign(a, a + n);
  for (int j = 0; j < n; ++j) size += std::abs(a[j]) * reach_[index(j)];
  for (int k = 0; k < n; ++k) {
    const long double mu = -alpha_[index(k)];
    if (mu <= 0.0L) continue;
    long double b = 0.0L;
    a = row(basis_[index(k)], &b);
    sum += mu * b;
    size += mu * std::abs(b);
    for (int j = 0; j < n; ++j) {
      sum_[index(j)] += mu * a[j];
      size += mu * std::abs(a[j]) * reach_[index(j)];
    }
  }
  for (int j = 0; j < n; ++j) sum += std::abs(sum_[index(j)]) * reach_[index(j)];
  return sum + kRounding * static_cast<long double>(n) * size < 0.0L;
}

LpResult ExtendedProgram::maximise(const long double* c, long double cutoff) {
  LpResult result;
  for (const long double jitter : kJitters) {
    result = attempt(c, cutoff, jitter);
    if (result.status != LpStatus::kFailed) break;
  }
  return result;
}

LpResult ExtendedProgram::attempt(const long double* c, long double cutoff, long double jitter) {
  const int n = dimension_;
  long double size = 0.0L;
  for (int j = 0; j < n; ++j) size = std::max(size, std::abs(c[j]));
  if (size == 0.0L) size = 1.0L;
  for (int j = 0; j < n; ++j) {
    const bool up = c[j] >= 0.0L;
    basis_[index(j)] = rows() + 2 * j + (up ? 0 : 1);
    // A fixed irregular sequence, scaled to |c| = 1: no two coordinates get the same ratio.
    const long double step = jitter * (0.5L + std::fmod(0.6180339887498949L * (j + 1), 1.0L));
    c_[index(j)] = c[j] / size + (up ? step : -step);
  }
  for (int iteration = 0; iteration < 150 + 50 * n; ++iteration) {
    if (!invert()) break;
    step_to_vertex();
    for (long double& y : y_) y *= size;
    const long double bound = dual_bound(c);
    for (long double& y : y_) y /= size;
    const double value =
        std::nextafter(static_cast<double>(bound), std::numeric_limits<double>::infinity());
    if (bound <= cutoff) return {LpStatus::kBelowCutoff, value};
    const bool first = iteration >= kFirst;
    const int entering = most_violated(first);
    if (entering < 0) return {LpStatus::kOptimal, value};
    long double b = 0.0L;
    make_up(row(entering, &b), alpha_);
    int out = leaving(kPivot, first);
    if (out < 0) {
      if (contradict(entering)) return {LpStatus::kInfeasible, value};
      out = leaving(kLeastPivot, first);
      if (out < 0) break;
    }
    basis_[index(out)] = entering;
  }
  return {};
}

bool ExtendedProgram::below(const std::vector<const ExtendedForm*>& rows,
                            const ExtendedForm& objective, long double cutoff) {
  clear();
  ExtendedForm a{};
  for (const ExtendedForm* form : rows) {
    for (int j = 0; j < dimension_; ++j) a[index(j)] = -(*form)[index(j)];
    append(a.data(), (*form)[index(dimension_)]);
  }
  const LpStatus status = maximise(objective.data(), cutoff - objective[index(dimension_)]).status;
  return status == LpStatus::kBelowCutoff || status == LpStatus::kInfeasible;
}

}  // namespace eampc::law_design
