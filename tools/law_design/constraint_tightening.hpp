// How far the true state may be from the predicted one, stage by stage: the amounts ε^i by which
// the state bounds of the design are moved inwards (Theorem 3.1), before anything runs.
#pragma once

#include <Eigen/Dense>

namespace eampc::law_design {

/// X and U: |θ|, |θ̇| and |u|. With valves, v stands for u: it is known, so no error enters by it.
struct StateBounds {
  double angle_max_rad = 0.0;
  double velocity_max_rad_s = 0.0;
  double control_max = 0.0;
};

/// Constants of Assumption 2.2, in the norm of (δ on ẋ1, δ on ẋ2).
struct LipschitzConstants {
  double l_delta = 0.0;    // ‖δ(t,x) − δ(τ,y)‖ ≤ l_delta ‖x−y‖ + l_t |t−τ|
  double l_t = 0.0;        // printed l_i in φ
  double b_delta = 0.0;    // ‖δ(t,0)‖
  double l_delta_t = 0.0;  // ‖∂δ/∂t‖ ≤ l_delta_t ‖x‖ + b_delta_t
  double b_delta_t = 0.0;
  double l_delta_x = 0.0;  // ‖∂δ/∂x‖ ≤ l_delta_x ‖x‖ + b_delta_x
  double b_delta_x = 0.0;
};

/// Stated bounds on the scalar d of ẋ2 = b1 x1 + b2 x2 + b v + d.
struct DisturbanceBounds {
  double max_rad_s2 = 0.0;
  double rate_max_rad_s3 = 0.0;
};

/// What the design knows of the estimate that is held over the horizon.
struct EstimateQuality {
  double age_s = 0.0;          // it describes d at most this long ago: one period
  double relative_bias = 0.0;  // 1 − e^{−aT} as printed, 0 with bias compensation
};

/// ‖ε^i‖ of (22), i = 0..horizon, in both columns; γ(T) with ρ as corrected:
/// ρ = (l_delta_t ‖x‖ + b_delta_t) + (l_delta_x ‖x‖ + b_delta_x)(‖Ax + Bu‖ + β), maxima over X×U.
Eigen::MatrixXd theorem_tightening(const Eigen::Matrix2d& A, const Eigen::Vector2d& B,
                                   const StateBounds& bounds, const LipschitzConstants& constants,
                                   double adaptation_rate_per_s, double period_s, int horizon);

/// |ε_j(iT)| ≤ ∫₀^{iT} |[e^{A(iT−s)}]_{j2}| φ(s) ds, (horizon + 1)×2, where
/// φ(s) = min(ḋ_max (s + age) + bias·d_max, 2 d_max) bounds |d(t_k+s) − d̂(t_k)|: since t_k − age
/// the disturbance moved by at most ḋ_max (s + age), and two values inside ±d_max differ by 2
/// d_max. The disturbance acts on ẋ2 only, so the sum over l of the general form has one term.
Eigen::MatrixXd componentwise_tightening(const Eigen::Matrix2d& A, const DisturbanceBounds& bounds,
                                         const EstimateQuality& estimate, double period_s,
                                         int horizon);

/// Throws DesignError if a tightened bound leaves no room, naming the stage, the bound and what to
/// change. `kind` is the name that stands in the rig file.
void require_room(const Eigen::MatrixXd& tightening, const StateBounds& bounds, const char* kind);

}  // namespace eampc::law_design
