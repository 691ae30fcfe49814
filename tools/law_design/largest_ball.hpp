// The largest ball in a polytope of the box [-1, 1]^n: a linear program in centre and radius.
#pragma once

#include <limits>

#include "law_design/half_spaces.hpp"
#include "law_design/linear_program.hpp"

namespace eampc::law_design {

class LargestBall {
 public:
  explicit LargestBall(int dimension);

  /// See LinearProgram.
  void set_perturbation(double size) { program_.set_perturbation(size); }

  void clear() { rows_.clear(); }
  /// Adds a·x ≤ b, |a| = 1. The box is implied.
  void append(const double* a, double b);
  /// The value bounds the radius from above; negative if the polytope is empty but the rows and
  /// the box do not contradict each other when all are moved outwards.
  LpResult find(double cutoff = -std::numeric_limits<double>::infinity());
  /// Of the last iterate: n coordinates, then the radius.
  const double* centre() const { return program_.point(); }
  double radius() const { return program_.point()[dimension_]; }

  long lp_count() const { return program_.count(); }

 private:
  int dimension_;
  LinearProgram program_;
  HalfSpaces rows_, box_;
};

}  // namespace eampc::law_design
