// Linear program in a box: max c·x subject to a_i·x ≤ b_i and lower ≤ x ≤ upper.
//
// Dual simplex on vertices: the start (the corner of the box that c points to) needs no feasible
// point, and every iterate is an upper bound of the optimum. So "is max c·x ≤ β?" stops at the
// first iterate that proves it, which is how nearly every question of this library ends.
// Rows are expected to have unit norm: tolerances are distances.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "law_design/half_spaces.hpp"

namespace eampc::law_design {

enum class LpStatus {
  kOptimal,      ///< point() is optimal
  kBelowCutoff,  ///< proved max c·x ≤ cutoff; point() is not feasible
  kInfeasible,   ///< proved: no point satisfies every row to within the tolerance
  kFailed,       ///< iteration limit; nothing is proved
};

struct LpResult {
  LpStatus status = LpStatus::kFailed;
  double value = std::numeric_limits<double>::infinity();  ///< c·x at point()
};

class LinearProgram {
 public:
  /// Distance by which a row may be violated, unless set otherwise.
  static constexpr double kTolerance = 1e-11;

  /// A program in the box [-1, 1]^dimension.
  explicit LinearProgram(int dimension);

  int dimension() const { return dimension_; }
  /// Size of the irregular change of c that breaks ties; the optimum is exact to n times this, or
  /// (in the rare second attempt after a failure) a safe upper bound within 3e-11·n.
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
  /// Programs solved so far.
  long count() const { return count_; }
  /// Rows tight at the last iterate: row index counted through all parts, or -1 for the box.
  std::span<const int> basis() const { return basis_rows_; }

 private:
  struct Entering {
    int row = -1;  // index through all parts, then 2·dimension box rows
    double violation = 0.0;
  };
  LpResult attempt(const double* c, std::span<const HalfSpaces* const> parts, double cutoff,
                   double perturbation);
  template <int N>
  LpResult solve(std::span<const HalfSpaces* const> parts, double cutoff);
  template <int N>
  Entering most_violated(std::span<const HalfSpaces* const> parts);
  void load_row(std::span<const HalfSpaces* const> parts, int row, double* a, double* b) const;
  bool refactorise(std::span<const HalfSpaces* const> parts);

  int dimension_;
  double perturbation_ = 1e-13;
  double tolerance_ = kTolerance;
  long count_ = 0;
  std::vector<double> lower_, upper_, c_, x_, multipliers_, inverse_, entering_, alpha_, excess_;
  std::vector<int> basis_rows_;
};

}  // namespace eampc::law_design
