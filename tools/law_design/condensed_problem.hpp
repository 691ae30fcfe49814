// Both optimal control problems with the states eliminated: a quadratic program in the inputs
// whose data are affine in the parameters p that the daemon knows at t_k.
#pragma once

#include <Eigen/Dense>

#include "law_design/discretisation.hpp"
#include "law_design/mpqp.hpp"

namespace eampc::law_design {

struct ControlProblem {
  int horizon = 0;                   // N
  int control_horizon = 0;           // free moves; after them: `paper` u held, `tracking` V = 0
  double weight_angle = 0.0;         // Q, per rad²
  double weight_velocity = 0.0;      // per (rad/s)², `tracking`
  double weight_control = 0.0;       // R, per unit² of u (`paper`) or u − u_ss (`tracking`)
  double weight_control_rate = 0.0;  // per unit² between successive moves, `tracking`
  double angle_max_rad = 0.0;
  double velocity_max_rad_s = 0.0;
  double control_max = 0.0;
  // State bounds at the stages N, N − step, N − 2 step, … > 0: between neighbouring stages they are
  // nearly the same, and each doubles the number of regions.
  int stage_step = 1;
  // State bounds share one slack s ≥ 0, the relative violation: |θ_i| ≤ θ̄_i (1 + s), at the price
  // slack_linear·s + slack_quadratic·s². Hard: no slack, and parts of the box have no solution.
  bool soft_state_bounds = true;
  double slack_linear = 0.0;
  double slack_quadratic = 0.0;
  Eigen::MatrixXd tightening;           // ε, (N + 1)×2
  bool reference_is_parameter = false;  // `paper`
  double fixed_reference_rad = 0.0;     // `paper`
  Eigen::VectorXd lower, upper;         // parameter box, in the order stated below
};

/// u = output_U·U + output_p·p + output_offset is the control to apply.
struct CondensedProblem {
  MpQp mpqp;
  Eigen::VectorXd output_U, output_p;
  double output_offset = 0.0;
};

/// Problem 1 as corrected, ideal valves: min Σ_{i=0..N} Q (θ_i − y_r)² + Σ_{i<N} R u_i², both sides
/// of every tightened state bound for i = 1..N (see stage_step), |u_i| ≤ u_max. p = (θ, θ̇, σ̂1, σ̂2[,
/// y_r]).
CondensedProblem paper_problem(const SampledModel& model, const ControlProblem& problem);

/// Offset-free tracking. p = (e, u_ss, y_r, ẏ_r), e = x − (y_r, ẏ_r[, u_ss]), V = U − u_ss:
/// min Σ_{i<N} Q_θ e1_i² + Q_ω e2_i² + R V_i² + R_Δ (V_i − V_{i−1})² + e_NᵀP e_N, P from the
/// Riccati equation, u_ss and the reference's velocity held over the horizon. The rate term starts
/// at i = 1: the input applied before is no parameter, so it cannot enter the first difference.
CondensedProblem tracking_problem(const SampledModel& model, const ControlProblem& problem);

}  // namespace eampc::law_design
