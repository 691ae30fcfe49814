// How long the daemon's controller takes: a closed loop is simulated once, then its samples go
// through fresh controllers again with nothing but the controller between two readings of the
// clock.
#pragma once

#include <vector>

#include "control/control_cycle.hpp"
#include "law_design/closed_loop_simulation.hpp"

namespace eampc::law_design {

/// Over the scenario's cycles; those before ACTIVE are run, not measured.
struct StepTiming {
  double total_s = 0.0;         // two readings of the clock around all of them
  std::vector<double> steps_s;  // one by one, in another pass; each includes one reading
};

struct ControllerTiming {
  StepTiming estimators_and_law;  // sample → x̂, d̂ → u
  StepTiming control_cycle;       // frame decoded, estimators, law, safety, frame encoded
};

/// The controls of each replay must be those of the run; std::runtime_error if they are not.
ControllerTiming time_steps(const control::ControllerConfig& config, const PlantParameters& plant,
                            const RunPlan& plan);

}  // namespace eampc::law_design
