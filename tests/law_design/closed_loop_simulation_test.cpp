#include "law_design/closed_loop_simulation.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "control/reference_joint.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

// The reference rig under a hand-tuned law of one piece u = −40 e1 − 2 e2 + u_ss.
TEST(ClosedLoopSimulation, ArmsAsARunOnTheBusAndTracksWithoutOffset) {
  control::ReferenceJoint joint = control::reference_joint();
  control::connect(joint);
  PlantParameters plant = reference_plant();
  plant.disturbance = {{DisturbanceKind::kStep, 20.0, 0.0, 1.0}};
  RunPlan plan;
  plan.duration_s = 4.0;
  plan.reference.kind = control::ReferenceKind::kStep;
  plan.reference.amplitude_rad = 0.2;
  plan.reference.start_s = 0.5;

  EXPECT_EQ(lead_cycles(joint.config, 20), 120);  // 20 + 0.5 s / 5 ms
  const auto rows = simulate(joint.config, plant, plan);
  ASSERT_EQ(rows.size(), 120u + 800u);
  EXPECT_EQ(rows[119].record.mode, control::Mode::kArming);
  EXPECT_EQ(rows[120].record.mode, control::Mode::kActive);
  EXPECT_EQ(rows[120].time_s, 0.0);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    ASSERT_EQ(rows[k].record.cycle, static_cast<std::int64_t>(k));
    ASSERT_EQ(rows[k].record.fault, control::Fault::kNone);
    if (k >= 120) {
      ASSERT_DOUBLE_EQ(rows[k].time_s, rows[k].record.scenario_time_s);
    }
  }
  EXPECT_EQ(rows[219].record.reference.angle_rad, 0.0);
  EXPECT_EQ(rows[220].record.reference.angle_rad, 0.2);
  EXPECT_NEAR(rows.back().truth.angle_rad, 0.2, 1e-3);
  EXPECT_EQ(rows.back().disturbance_rad_s2, 20.0);
}

}  // namespace
}  // namespace eampc::law_design
