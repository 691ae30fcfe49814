// A reference trajectory from Python's arguments; used by the bound control cycle and the bound
// simulation.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <optional>
#include <string>
#include <vector>

#include "control/reference_trajectory.hpp"

namespace eampc::law_design {

using RowArray =
    nanobind::ndarray<const double, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;

struct ReferenceArguments {
  std::string kind;  // constant, step, sine, table
  double amplitude_rad = 0.0;
  double offset_rad = 0.0;
  double start_s = 0.0;
  double frequency_hz = 0.0;
  std::optional<RowArray> table;  // (n, 3): rad, rad/s, rad/s²
  double sample_period_s = 0.0;
};

// The table's rows go to `rows`, which must live as long as the trajectory. ValueError in Python
// for a bad argument.
control::ReferenceTrajectory reference_trajectory(const ReferenceArguments& arguments,
                                                  std::vector<control::Reference>& rows);

}  // namespace eampc::law_design
