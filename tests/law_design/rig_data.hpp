// The ready rigs' numbers, written out so that the tests do not depend on the rig files.
#pragma once

#include "law_design/joint_model.hpp"
#include "law_design/simulated_joint.hpp"

namespace eampc::law_design {

inline JointData reference_rig() {
  return {.moment_of_inertia_kg_m2 = 0.05,
          .viscous_damping_N_m_s_rad = 0.5,
          .gear_radius_m = 0.025,
          .k1_N_per_MPa = 10000.0,
          .k2_N_per_MPa = -7500.0,
          .k3_N_per_MPa = 1600.0,
          .initial_contraction_ratio = 0.1,
          .initial_length_m = 0.2,
          .pressure_gain_MPa_per_V = 0.09,
          .control_gain_V = 0.45,
          .bias_V = 5.0,
          .valve_time_constant_s = 0.03};
}

// The joint of that rig as it is simulated.
inline PlantParameters reference_plant() {
  PlantParameters plant;
  plant.moment_of_inertia_kg_m2 = 0.05;
  plant.viscous_damping_N_m_s_rad = 0.5;
  plant.gear_radius_m = 0.025;
  plant.k1_N_per_MPa = 10000.0;
  plant.k2_N_per_MPa = -7500.0;
  plant.k3_N_per_MPa = 1600.0;
  plant.initial_contraction_ratio = 0.1;
  plant.initial_length_m = 0.2;
  plant.pressure_gain_MPa_per_V = 0.09;
  plant.max_V = 10.0;
  plant.valve_time_constant_s = 0.03;
  return plant;
}

inline JointData paper_rig(double bias_V) {
  return {.moment_of_inertia_kg_m2 = 0.05,
          .viscous_damping_N_m_s_rad = 0.1,
          .gear_radius_m = 0.25,
          .k1_N_per_MPa = 10.0,
          .k2_N_per_MPa = 7.5,
          .k3_N_per_MPa = 1.6,
          .initial_contraction_ratio = 0.1,
          .initial_length_m = 0.2,
          .pressure_gain_MPa_per_V = 0.09,
          .control_gain_V = 0.45,
          .bias_V = bias_V};
}

}  // namespace eampc::law_design
