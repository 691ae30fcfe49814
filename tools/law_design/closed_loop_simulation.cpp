#include "law_design/closed_loop_simulation.hpp"

#include <cmath>

#include "control/arming.hpp"
#include "law_design/offline_config.hpp"

namespace eampc::law_design {

int lead_cycles(const control::ControllerConfig& config, int arm_at_cycle) {
  return arm_at_cycle + control::arming_periods(config.safety, config.model.period_s);
}

std::vector<SimulatedCycle> simulate(const control::ControllerConfig& daemon_config,
                                     const PlantParameters& plant, const RunPlan& plan) {
  const control::ControllerConfig config = offline_config(daemon_config);
  const double T = config.model.period_s;
  const int lead = lead_cycles(config, plan.arm_at_cycle);
  const int cycles = lead + static_cast<int>(std::round(plan.duration_s / T));
  SimulatedJoint joint(plant, T);
  control::ControlCycle controller(config);
  std::vector<SimulatedCycle> rows;
  rows.reserve(static_cast<std::size_t>(cycles));
  for (int k = 0; k < cycles; ++k) {
    SimulatedCycle row;
    row.time_s = (k - lead) * T;
    row.truth = joint.state();
    row.torque_N_m = joint.torque_N_m();
    row.disturbance_rad_s2 = joint.disturbance_rad_s2(row.time_s);
    const control::Frame encoder_frame = joint.encoder_frame(config.encoder);
    control::CycleInput input;
    input.bus.queue_proved_empty = true;  // no bus between
    input.encoder_frame = &encoder_frame;
    if (k == 0) {
      input.new_reference = &plan.reference;
    }
    if (k == plan.arm_at_cycle) {
      input.action = control::OperatorAction::kArm;
    }
    const control::CycleOutput output = controller.step(input);
    joint.advance(config.valve_command, output.command, row.time_s);
    row.record = output.record;
    rows.push_back(row);
  }
  return rows;
}

}  // namespace eampc::law_design
