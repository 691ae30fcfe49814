// Linear program in a box: max c·x subject to a_i·x ≤ b_i and lower ≤ x ≤ upper.
//
// Dual simplex on vertices: the start (the corner of the box that c points to) needs no feasible
// point, and every iterate is an upper bound of the optimum. So "is max c·x ≤ β?" stops at the
// first iterate that proves it, which is how nearly every question of this library ends.
// Rows are expected to have unit norm: tolerances are distances.
//
// No answer rests on how the vertices were walked. With multipliers y ≥ 0 of the basis, every x of
// the box that satisfies the rows has c·x ≤ Σ y_k b_k + Σ_j |c − Σ y_k a_k|_j max|x_j|: weak
// duality, whatever y is. And it has g·x ≤ h for g = a + Σ μ_k a_k, h = b + Σ μ_k b_k, μ ≥ 0: with
// h below the least g·x of the box there is none (Farkas). Both sums are made anew from the rows,
// and rounding is added to them. What the quick walk cannot prove so is walked again in extended
// precision.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/linear_program_result.hpp"

namespace eampc::law_design {

class LinearProgram {
 public:
  /// Distance by which a row may be violated, unless set otherwise.
  static constexpr double kTolerance = 1e-11;

  /// A program in the box [-1, 1]^dimension.
  explicit LinearProgram(int dimension);

  int dimension() const { return dimension_; }
  /// Size of the irregular change of c that breaks ties; the optimum is exact to n times this.
  void set_perturbation(double size) { perturbation_ = size; }
  /// Distance by which a row may be violated from now on.
  void set_tolerance(double distance) { tolerance_ = distance; }
  void set_bounds(int j, double lower, double upper);

  /// Maximises c·x over the rows of all `parts`.
  LpResult maximise(const double* c, std::span<const HalfSpaces* const> parts,
                    double cutoff = -std::numeric_limits<double>::infinity());
  LpResult maximise(const double* c, const HalfSpaces& rows,
                    double cutoff = -std::numeric_limits<double>::infinity()) {
    const HalfSpaces* parts[] = {&rows};
    return maximise(c, parts, cutoff);
  }

  /// The last iterate.
  const double* point() const { return x_.data(); }
  /// Programs solved so far, and how many of them in extended precision.
  long count() const { return count_; }
  long careful_count() const { return careful_count_; }
  /// Rows tight at the last iterate: row index counted through all parts, or -1 for the box.
  std::span<const int> basis() const { return basis_rows_; }

 private:
  struct Entering {
    int row = -1;  // index through all parts, then 2·dimension box rows
    double violation = 0.0;
  };
  LpResult solve_quickly(std::span<const HalfSpaces* const> parts, double cutoff);
  LpResult solve_carefully(std::span<const HalfSpaces* const> parts, double cutoff);
  template <int N>
  LpResult solve(std::span<const HalfSpaces* const> parts, double cutoff);
  template <int N>
  Entering most_violated(std::span<const HalfSpaces* const> parts);
  void load_row(std::span<const HalfSpaces* const> parts, int row, double* a, double* b) const;
  bool refactorise(std::span<const HalfSpaces* const> parts);
  double dual_bound(std::span<const HalfSpaces* const> parts);
  bool contradict(std::span<const HalfSpaces* const> parts, double b);
  double reach(int j) const;

  int dimension_;
  double perturbation_ = 1e-13;
  double tolerance_ = kTolerance;
  long count_ = 0, careful_count_ = 0;
  std::vector<double> lower_, upper_, c_, x_, multipliers_, inverse_, entering_, alpha_, excess_;
  std::vector<double> row_, sum_;
  std::vector<int> basis_rows_;
};

}  // namespace eampc::law_design
