// Continuous model → x⁺ = A* x + B* u + D δ over one period with u and δ held.
#pragma once

#include <Eigen/Dense>

namespace eampc::law_design {

struct SampledModel {
  double period_s = 0.0;
  Eigen::MatrixXd A_star;  // e^{AT}
  Eigen::VectorXd B_star;  // ∫₀ᵀ e^{Aτ} dτ · B
  Eigen::MatrixXd D;  // ∫₀ᵀ e^{Aτ} dτ, the two columns of the disturbance on (ẋ1, ẋ2)
};

/// One matrix exponential, exp([[A, B, I], [0, 0, 0], [0, 0, 0]]·T), in place of the A⁻¹ of (20):
/// it exists for every A, also for the singular one of u0 = 0.
SampledModel discretise(const Eigen::MatrixXd& A, const Eigen::VectorXd& B, double period_s);

}  // namespace eampc::law_design
