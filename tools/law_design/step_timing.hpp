// How long the daemon's controller takes: a closed loop is simulated once, then its samples go
// through fresh controllers again with nothing but the controller between two readings of the
// clock.
#pragma once

#include "control/control_cycle.hpp"
#include "law_design/closed_loop_simulation.hpp"

namespace eampc::law_design {

/// Processor time of the calling thread over the scenario's cycles; those before ACTIVE are run,
/// not measured. The cycles follow one another without the plant between them: caches are warm.
struct ControllerTiming {
  double estimators_and_law_s = 0.0;  // sample → x̂, d̂ → u
  double control_cycle_s = 0.0;       // frame decoded, estimators, law, safety, frame encoded
};

/// The controls of each replay must be those of the run; std::runtime_error if they are not.
ControllerTiming time_steps(const control::ControllerConfig& config, const PlantParameters& plant,
                            const RunPlan& plan);

}  // namespace eampc::law_design
