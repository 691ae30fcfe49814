// Linear program in extended precision, for the questions that doubles cannot decide: in a corner
// between two nearly parallel rows, a tolerance of 1e-11 on the rows is a step of 1e-4.
//
// Dual simplex as in linear_program.hpp, with a fresh inverse at every vertex; its answers are
// proved in the same way, by weak duality and Farkas' lemma from the rows themselves.
#pragma once

#include <array>
#include <limits>
#include <span>
#include <vector>

#include "law_design/linear_program_result.hpp"
#include "law_design/polytope.hpp"

namespace eampc::law_design {

/// c[0..np)·q + c[np].
using ExtendedForm = std::array<long double, kMaxDimension + 1>;

class ExtendedProgram {
 public:
  /// Distance by which a row may be violated, unless set otherwise.
  static constexpr long double kTolerance = 1e-17L;

  /// In the box [-1, 1]^dimension.
  explicit ExtendedProgram(int dimension);

  void set_tolerance(double distance) { tolerance_ = distance; }
  void set_bounds(int j, double lower, double upper);

  void clear() { offsets_.clear(), normals_.clear(); }
  /// Adds a·x ≤ b, |a| = 1.
  template <typename T>
  void append(const T* a, long double b) {
    normals_.insert(normals_.end(), a, a + dimension_);
    offsets_.push_back(b);
  }
  /// Maximises c·x; value as in LpResult, rounded up.
  LpResult maximise(const long double* c,
                    long double cutoff = -std::numeric_limits<long double>::infinity());
  /// True if proved: no q in the box with form·(q, 1) ≥ 0 for all `rows` (unit) has
  /// objective·(q, 1) > cutoff.
  bool below(const std::vector<const ExtendedForm*>& rows, const ExtendedForm& objective,
             long double cutoff);
  /// The last iterate.
  const long double* point() const { return x_.data(); }
  /// Rows tight there; after the rows the upper and lower bounds of x_0, x_1 …
  std::span<const int> basis() const { return basis_; }

 private:
  using Numbers = std::vector<long double>;
  int rows() const { return static_cast<int>(offsets_.size()); }
  const long double* row(int i, long double* b);
  bool invert();
  void make_up(const long double* a, Numbers& shares);
  void step_to_vertex();
  long double dual_bound(const long double* c);
  int most_violated(bool first);
  int leaving(long double pivot, bool first) const;
  bool contradict(int entering);
  LpResult attempt(const long double* c, long double cutoff, long double jitter);

  int dimension_;
  long double tolerance_ = kTolerance;
  Numbers lower_, upper_, reach_;
  Numbers normals_, offsets_;  // row by row
  Numbers c_, x_, y_, alpha_, side_, sum_, matrix_, inverse_;
  std::vector<int> basis_;
};

}  // namespace eampc::law_design
