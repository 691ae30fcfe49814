// Cost to go after the horizon: the stabilising solution of the discrete Riccati equation.
#pragma once

#include <Eigen/Dense>

namespace eampc::law_design {

/// P = Q + AᵀPA − AᵀPB (R + BᵀPB)⁻¹ BᵀPA for one input, R > 0. Throws DesignError if the model
/// has an unstable mode that the input does not reach.
Eigen::MatrixXd riccati_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                 const Eigen::MatrixXd& Q, const Eigen::MatrixXd& R);

}  // namespace eampc::law_design
