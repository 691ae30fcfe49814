// How long one evaluation of an explicit law takes, clip included, in the five ways in which that
// can be asked. In: a packed law, points → out: nanoseconds.
// Absent: the checks and clamps of the control cycle around the law (step_timing has the whole).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "control/point_location.hpp"

namespace eampc::law_design {

struct LawTimingPlan {
  double u_min = 0.0;
  double u_max = 0.0;
  int sweeps = 15;           // over all points; the median of them counts
  int repetitions = 41;      // of each single point; the least of them counts
  int cold_points = 512;     // of the first ones
  int cold_repetitions = 5;  // the least of them counts
};

struct LawTiming {
  double timer_ns = 0.0;  // of two readings of the clock with nothing between them: least of many
  double sweep_ns = 0.0;  // per evaluation, over whole sweeps: warm, the points known
  double fresh_ns = 0.0;  // per evaluation, each point used once: median of parts
  double chain_ns = 0.0;  // per evaluation, each point waits for the value before it
  std::vector<double> point_ns;  // each point alone, warm, timer included
  std::vector<double> cold_ns;   // the same after `kColdBytes` of other memory were written
};

inline constexpr std::size_t kColdBytes = std::size_t{4} << 20;

// `points` and `fresh`: rows of law.n_parameters.
LawTiming time_law(const control::PackedLaw& law, std::span<const double> points,
                   std::span<const double> fresh, const LawTimingPlan& plan);

}  // namespace eampc::law_design
