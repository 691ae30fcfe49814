// The cycles of a simulated run as columns; used by whatever binding runs one.
#pragma once

#include <nanobind/nanobind.h>

#include <vector>

#include "law_design/closed_loop_simulation.hpp"

namespace eampc::law_design {

// One array per column, names and units as eampc.simulation.SimulationResult has them.
nanobind::dict cycle_columns(const std::vector<SimulatedCycle>& rows);

}  // namespace eampc::law_design
