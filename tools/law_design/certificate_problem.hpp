// The problem as the certificate sees it: parameters scaled to ±1, everything in extended
// precision, made from the data of the law file alone. Nothing here is shared with the explorer.
#pragma once

#include <Eigen/Dense>
#include <string>
#include <vector>

#include "law_design/mpqp.hpp"

namespace eampc::law_design {

using ExtendedMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// min ½UᵀHU + (F (q, 1))ᵀU subject to G U ≤ W (q, 1), q ∈ [-1, 1]^np, and y = Y_U U + Y (q, 1)
/// scaled so that y_min is 0 and y_max is 1. Functions of q are rows of np + 1 coefficients.
struct CertificateProblem {
  int variables = 0;   // n
  int parameters = 0;  // np
  int rows = 0;        // m
  Eigen::VectorXd centre, half_width;
  ExtendedMatrix H, F, G, W;
  /// Cholesky factor, H = L Lᵀ: z = Lᵀ U + L⁻¹ F (q, 1) is the distance to the unconstrained
  /// optimum, and row i reads M_i z ≤ D_i (q, 1), |M_i| = 1. Rows without U have norm 0.
  ExtendedMatrix L, M, D;
  std::vector<long double> norms;  ///< of the rows G L⁻ᵀ
  /// Row → the first row that is the same but for its length: only that one counts.
  std::vector<int> first_equal;
  ExtendedMatrix Y_U, Y;      ///< 1×n, 1×(np+1)
  double output_range = 1.0;  ///< y_max − y_min in units of the output
  double smallest_eigenvalue = 0.0;
  double largest_eigenvalue = 0.0;
};

/// Throws std::invalid_argument, one sentence, for shapes that do not fit, numbers that are not
/// finite, an empty box, an output without a range, or an H that is not positive definite.
CertificateProblem certificate_problem(const MpQp& problem, const OutputLaw& output);

}  // namespace eampc::law_design
