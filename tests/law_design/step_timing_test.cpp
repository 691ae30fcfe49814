#include "law_design/step_timing.hpp"

#include <gtest/gtest.h>

#include "control/reference_joint.hpp"

namespace eampc::law_design {
namespace {

// Both replays throw unless they decide what the run decided, in every cycle and to the last bit:
// through the arming ramp, under a load step and a moving reference.
TEST(StepTiming, MeasuresTheSameControllerAsTheRun) {
  control::ReferenceJoint joint = control::reference_joint();
  control::connect(joint);
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
  plant.encoder_noise_rad = 1e-4;
  plant.disturbance = {{DisturbanceKind::kStep, 20.0, 0.0, 0.5}};
  RunPlan plan;
  plan.duration_s = 1.5;
  plan.reference.kind = control::ReferenceKind::kSine;
  plan.reference.amplitude_rad = 0.2;
  plan.reference.frequency_hz = 1.0;

  const ControllerTiming timing = time_steps(joint.config, plant, plan);
  EXPECT_GT(timing.estimators_and_law_s, 0.0);
  EXPECT_GT(timing.control_cycle_s, 0.0);
}

}  // namespace
}  // namespace eampc::law_design
