// The daemon's own control cycle against the simulated joint, frame by frame, with the operator's
// sequence of a run on the bus: DISARMED, arm at a given cycle, ramp, ACTIVE. Scenario time 0 is
// the first ACTIVE cycle.
#pragma once

#include <vector>

#include "control/control_cycle.hpp"
#include "law_design/simulated_joint.hpp"

namespace eampc::law_design {

struct RunPlan {
  double duration_s = 0.0;  // of the scenario, from ACTIVE on
  int arm_at_cycle = 20;
  control::ReferenceTrajectory reference;
};

// One row per cycle: what the daemon recorded, and the truth at the instant of its encoder frame.
struct SimulatedCycle {
  control::CycleRecord record;
  double time_s = 0.0;  // scenario time, negative before ACTIVE
  PlantState truth;
  double torque_N_m = 0.0;
  double disturbance_rad_s2 = 0.0;
};

// Cycles before ACTIVE: arm_at_cycle, the arming ramp, the law within reduced limits.
int lead_cycles(const control::ControllerConfig& config, int arm_at_cycle);

// lead + round(duration / T) cycles.
std::vector<SimulatedCycle> simulate(const control::ControllerConfig& config,
                                     const PlantParameters& plant, const RunPlan& plan);

}  // namespace eampc::law_design
