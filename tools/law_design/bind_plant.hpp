// A simulated joint's parameters from Python's dicts; used by whatever binding runs one.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/vector.h>

#include <vector>

#include "law_design/simulated_joint.hpp"

namespace eampc::law_design {

// plant: the numbers of [joint], [muscle], [valve] and [emulator] with their rig-file names;
// disturbance: terms as in the rig file. ValueError in Python for a key that is missing, unknown or
// out of range.
PlantParameters plant_of(const nanobind::dict& plant,
                         const std::vector<nanobind::dict>& disturbance);

}  // namespace eampc::law_design
