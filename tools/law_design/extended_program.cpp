#include "law_design/extended_program.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

namespace eampc::law_design {
namespace {

// A multiplier may slip below zero by this in one step …
constexpr long double kSlip = 1e-15L;
// … and is then worth no more than its row's slack within the box: |b| + |a|₁ of a unit row.
constexpr long double kMostSlack = 6.0L;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

// Row i as a·q ≤ b; after the rows the sides of the box.
void ExtendedProgram::load(const std::vector<const ExtendedForm*>& rows, int row, long double* a,
                           long double* b) const {
  const int m = static_cast<int>(rows.size());
  if (row < m) {
    const ExtendedForm& form = *rows[index(row)];
    for (int j = 0; j < dimension_; ++j) a[j] = -form[index(j)];
    *b = form[index(dimension_)];
    return;
  }
  std::fill(a, a + dimension_, 0.0L);
  a[(row - m) / 2] = (row - m) % 2 == 0 ? 1.0L : -1.0L;
  *b = 1.0L;
}

// Inverse of the basis (rows of it: rows of the matrix), by Gauss with row pivots.
bool ExtendedProgram::invert(const std::vector<const ExtendedForm*>& rows, Square& inverse) const {
  const int n = dimension_;
  Square matrix{};
  long double b = 0.0L;
  for (int k = 0; k < n; ++k) {
    load(rows, basis_[index(k)], matrix[index(k)].data(), &b);
    inverse[index(k)].fill(0.0L);
    inverse[index(k)][index(k)] = 1.0L;
  }
  for (int c = 0; c < n; ++c) {
    int pivot = c;
    for (int r = c + 1; r < n; ++r) {
      if (std::abs(matrix[index(r)][index(c)]) > std::abs(matrix[index(pivot)][index(c)])) {
        pivot = r;
      }
    }
    if (std::abs(matrix[index(pivot)][index(c)]) < 1e-17L) return false;
    std::swap(matrix[index(c)], matrix[index(pivot)]);
    std::swap(inverse[index(c)], inverse[index(pivot)]);
    const long double scale = 1.0L / matrix[index(c)][index(c)];
    for (int j = 0; j < n; ++j) {
      matrix[index(c)][index(j)] *= scale;
      inverse[index(c)][index(j)] *= scale;
    }
    for (int r = 0; r < n; ++r) {
      const long double factor = matrix[index(r)][index(c)];
      if (r == c || factor == 0.0L) continue;
      for (int j = 0; j < n; ++j) {
        matrix[index(r)][index(j)] -= factor * matrix[index(c)][index(j)];
        inverse[index(r)][index(j)] -= factor * inverse[index(c)][index(j)];
      }
    }
  }
  return true;
}

bool ExtendedProgram::below(const std::vector<const ExtendedForm*>& rows,
                            const ExtendedForm& objective, long double cutoff) {
  // Another objective leads past a basis that cannot be inverted; within the box it differs by no
  // more than `most`.
  for (const long double change : {0.0L, 1e-14L, 1e-13L, 1e-12L}) {
    ExtendedForm changed = objective;
    long double most = 0.0L;
    for (int j = 0; j < dimension_; ++j) {
      const long double step = change * (0.5L + std::fmod(0.6180339887498949L * (j + 1), 1.0L));
      changed[index(j)] += objective[index(j)] < 0.0L ? -step : step;
      most += step;
    }
    const Outcome outcome = attempt(rows, changed, cutoff - most);
    if (outcome != Outcome::kLost) return outcome == Outcome::kProved;
  }
  return false;
}

ExtendedProgram::Outcome ExtendedProgram::attempt(const std::vector<const ExtendedForm*>& rows,
                                                  const ExtendedForm& objective,
                                                  long double cutoff) {
  const int n = dimension_;
  const int m = static_cast<int>(rows.size());
  const long double limit = cutoff - objective[index(n)];
  for (int j = 0; j < n; ++j) {
    basis_[index(j)] = m + 2 * j + (objective[index(j)] >= 0.0L ? 0 : 1);
  }
  std::array<long double, kMaxDimension> a{}, x{}, y{}, alpha{};
  for (int iteration = 0; iteration < 150 + 50 * n; ++iteration) {
    Square inverse{};
    if (!invert(rows, inverse)) return Outcome::kLost;
    x.fill(0.0L);
    y.fill(0.0L);
    // Refined, so that the basis rows hold to rounding however nearly parallel they are.
    for (int pass = 0; pass < 3; ++pass) {
      alpha = x;
      for (int k = 0; k < n; ++k) {
        long double rest = 0.0L;
        load(rows, basis_[index(k)], a.data(), &rest);
        for (int j = 0; j < n; ++j) rest -= a[index(j)] * x[index(j)];
        for (int j = 0; j < n; ++j) alpha[index(j)] += inverse[index(j)][index(k)] * rest;
      }
      x = alpha;
    }
    for (int k = 0; k < n; ++k) {
      for (int j = 0; j < n; ++j) {
        y[index(k)] += objective[index(j)] * inverse[index(j)][index(k)];
      }
    }
    long double value = 0.0L;
    for (int j = 0; j < n; ++j) value += objective[index(j)] * x[index(j)];
    for (int k = 0; k < n; ++k) value += kMostSlack * std::max(-y[index(k)], 0.0L);
    if (value <= limit) return Outcome::kProved;
    int entering = -1;
    long double violation = kTolerance;
    for (int i = 0; i < m + 2 * n; ++i) {
      long double b = 0.0L;
      load(rows, i, a.data(), &b);
      long double excess = -b;
      for (int j = 0; j < n; ++j) excess += a[index(j)] * x[index(j)];
      if (std::find(basis_.begin(), basis_.begin() + n, i) != basis_.begin() + n) continue;
      // After many steps the first violated row: that rule does not cycle.
      if (excess > violation && (iteration < 100 || entering < 0)) {
        violation = excess;
        entering = i;
      }
    }
    if (entering < 0) return Outcome::kOpen;
    long double b = 0.0L;
    load(rows, entering, a.data(), &b);
    // Harris' ratio test: the largest pivot among the first.
    long double reach = std::numeric_limits<long double>::infinity();
    for (int k = 0; k < n; ++k) {
      alpha[index(k)] = 0.0L;
      for (int j = 0; j < n; ++j) {
        alpha[index(k)] += a[index(j)] * inverse[index(j)][index(k)];
      }
      if (alpha[index(k)] <= 1e-15L) continue;
      reach = std::min(reach, (std::max(y[index(k)], 0.0L) + kSlip) / alpha[index(k)]);
    }
    int leaving = -1;
    for (int k = 0; k < n; ++k) {
      if (alpha[index(k)] <= 1e-15L || std::max(y[index(k)], 0.0L) > reach * alpha[index(k)]) {
        continue;
      }
      if (leaving < 0 || alpha[index(k)] > alpha[index(leaving)]) leaving = k;
    }
    // The entering row and the basis contradict each other.
    if (leaving < 0) return Outcome::kProved;
    basis_[index(leaving)] = entering;
  }
  return Outcome::kLost;
}

}  // namespace eampc::law_design
