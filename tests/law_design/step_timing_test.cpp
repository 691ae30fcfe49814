#include "law_design/step_timing.hpp"

#include <gtest/gtest.h>

#include "control/reference_joint.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

// Both replays throw unless they decide what the run decided, in every cycle and to the last bit:
// through the arming ramp, under a load step and a moving reference.
TEST(StepTiming, MeasuresTheSameControllerAsTheRun) {
  control::ReferenceJoint joint = control::reference_joint();
  control::connect(joint);
  PlantParameters plant = reference_plant();
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
