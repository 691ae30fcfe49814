// A multiparametric QP in least-distance form, scaled and without redundant rows:
//   min ½‖z‖²  subject to  M z ≤ D (q, 1),  q ∈ [-1, 1]^np,
// with p = centre + half_width·q and U = back·z + shift·(q, 1). Rows of M have unit norm, and z is
// scaled so that the largest optimal z seen has norm 1.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/quadratic_program.hpp"

namespace eampc::law_design {

struct LeastDistanceForm {
  using RowMatrix = LeastDistanceProgram::RowMatrix;

  int variables = 0;
  int parameters = 0;
  Eigen::VectorXd centre, half_width;
  RowMatrix rows;                  ///< M, m×n
  RowMatrix bounds;                ///< D, m×(np+1)
  std::vector<int> original_rows;  ///< row of the problem as given, per row of M
  std::vector<double> tolerances;  ///< violations of M z ≤ d that count as rounding
  HalfSpaces parameter_rows;       ///< rows that bound parameters only, in q, unit norm
  std::vector<int> parameter_row_origin;
  Eigen::MatrixXd back;         ///< n×n
  Eigen::MatrixXd shift;        ///< n×(np+1)
  double z_bound = 0.0;         ///< rows were reduced within |z_j| ≤ z_bound …
  bool z_bound_proved = false;  ///< … which holds at every optimum (else: check the regions)
  std::vector<Eigen::VectorXd> feasible_points;  ///< some q where the problem has a solution
  long lps = 0;
  long qps = 0;

  /// d(q) = D (q, 1).
  void right_side(const double* q, double* d) const;
};

/// Brings a problem into this form. Throws std::invalid_argument with one sentence if it has no
/// strictly convex cost, an empty box, or no feasible parameter.
LeastDistanceForm to_least_distance_form(const MpQp& problem);

}  // namespace eampc::law_design
