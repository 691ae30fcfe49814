#include "law_design/joint_model.hpp"

#include "law_design/design_error.hpp"

namespace eampc::law_design {

ContinuousModel joint_model(const JointData& joint) {
  const double J = joint.moment_of_inertia_kg_m2;
  const double r = joint.gear_radius_m;
  const double epsilon_0 = joint.initial_contraction_ratio;
  const double k0 = joint.pressure_gain_MPa_per_V;

  ContinuousModel model;
  // (9). k4 cancels in (5): both muscles share it.
  model.b = 2.0 * k0 * joint.control_gain_V * r *
            (joint.k1_N_per_MPa * epsilon_0 * epsilon_0 + joint.k2_N_per_MPa * epsilon_0 +
             joint.k3_N_per_MPa) /
            J;
  model.b1 = 2.0 * k0 * joint.bias_V * r * r *
             (2.0 * joint.k1_N_per_MPa * epsilon_0 + joint.k2_N_per_MPa) /
             (joint.initial_length_m * J);
  model.b2 = -joint.viscous_damping_N_m_s_rad / J;
  model.valve_time_constant_s = joint.valve_time_constant_s;
  if (!(model.b > 0.0)) {
    throw DesignError(
        "the muscles give no torque for a positive control (b of equation (9) is not positive); "
        "check muscle.k1_N_per_MPa, k2_N_per_MPa, k3_N_per_MPa and "
        "muscle.initial_contraction_ratio");
  }

  const bool has_valves = joint.valve_time_constant_s > 0.0;
  const int order = has_valves ? 3 : 2;
  model.A = Eigen::MatrixXd::Zero(order, order);
  model.B = Eigen::VectorXd::Zero(order);
  model.A(0, 1) = 1.0;
  model.A(1, 0) = model.b1;
  model.A(1, 1) = model.b2;
  if (has_valves) {
    model.A(1, 2) = model.b;
    model.A(2, 2) = -1.0 / joint.valve_time_constant_s;
    model.B(2) = 1.0 / joint.valve_time_constant_s;
  } else {
    model.B(1) = model.b;
  }
  return model;
}

}  // namespace eampc::law_design
