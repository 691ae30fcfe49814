// Joint and muscle data → the linear model of (9), with or without the valves' first-order lag.
#pragma once

#include <Eigen/Dense>

namespace eampc::law_design {

/// Table I with units; k1..k3 in N/MPa because the pressure gain k0 is in MPa/V.
struct JointData {
  double moment_of_inertia_kg_m2 = 0.0;    // J
  double viscous_damping_N_m_s_rad = 0.0;  // b_v
  double gear_radius_m = 0.0;              // r of (4) to (7)
  double k1_N_per_MPa = 0.0;
  double k2_N_per_MPa = 0.0;
  double k3_N_per_MPa = 0.0;
  double initial_contraction_ratio = 0.0;  // ε0
  double initial_length_m = 0.0;           // L0
  double pressure_gain_MPa_per_V = 0.0;    // k0
  double control_gain_V = 0.0;             // ku, printed as k_a in Table I
  double bias_V = 0.0;                     // u0
  double valve_time_constant_s = 0.0;      // τ_v; 0: ideal valves, v = u
};

/// ẋ = A x + B u + (δ; 0), x = (θ, θ̇) or, with valves, (θ, θ̇, v).
struct ContinuousModel {
  double b = 0.0;   // rad/s² per unit of v
  double b1 = 0.0;  // 1/s²
  double b2 = 0.0;  // 1/s
  double valve_time_constant_s = 0.0;
  Eigen::MatrixXd A;
  Eigen::VectorXd B;

  int order() const { return static_cast<int>(A.rows()); }
  /// (θ, θ̇) alone: what the disturbance drives and the state bounds see.
  Eigen::Matrix2d joint_A() const { return A.topLeftCorner<2, 2>(); }
  Eigen::Vector2d joint_B() const { return {0.0, b}; }
};

ContinuousModel joint_model(const JointData& joint);

}  // namespace eampc::law_design
