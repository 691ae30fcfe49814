// One trial of a campaign. In: the campaign's nominal plant, tolerances and ranges, its seed and
// the trial's index → out: a plant, a disturbance, a reference, a start and a noise level.
// The same seed and index give the same trial on every machine.
#pragma once

#include <cstdint>

#include "control/reference_trajectory.hpp"
#include "law_design/simulated_joint.hpp"

namespace eampc::law_design {

// Half-widths as ratios of the nominal value: 0.2 is ±20 %.
struct PlantTolerances {
  double moment_of_inertia = 0.0;  // J of (5)
  double control_gain = 0.0;       // b of (9) beyond what J does to it
  double stiffness = 0.0;          // b1 of (9), likewise
  double viscous_damping = 0.0;    // b_v of (5)
  double valve_lag = 0.0;          // τ_v
};

// Half-widths about zero, but the start's, which lies about the nominal plant's initial state.
struct TrialRanges {
  double disturbance_rad_s2 = 0.0;
  double disturbance_rate_rad_s3 = 0.0;
  double start_angle_rad = 0.0;
  double start_velocity_rad_s = 0.0;
  double reference_angle_rad = 0.0;
  double reference_step_rad = 0.0;  // of one step, and of the first reference
  double reference_velocity_rad_s = 0.0;
  double encoder_noise_rad = 0.0;  // largest standard deviation; each trial draws its own
  double velocity_noise_rad_s = 0.0;
};

struct Campaign {
  PlantParameters nominal;  // its disturbance, substeps and seed are not used
  PlantTolerances tolerances;
  TrialRanges ranges;
  double angle_bound_rad = 0.0;  // the law's state bounds; a violation is counted, not prevented
  double velocity_bound_rad_s = 0.0;
  double duration_s = 2.0;  // from ACTIVE on
  std::uint64_t seed = 1;
};

// d(t) in rad/s²: a ramp between two levels and a sine. Their shares of the two bounds add up to
// one, so that |d| and |ḋ| keep them. Before ACTIVE, d grows from 0 to d(0) with the valves.
struct TrialDisturbance {
  double first_level_rad_s2 = 0.0;
  double last_level_rad_s2 = 0.0;
  std::int64_t ramp_begin = 0;  // in periods: the kinks lie on the grid of the integrator
  std::int64_t ramp_end = 0;
  double sine_rad_s2 = 0.0;
  double frequency_hz = 0.0;
  double phase_rad = 0.0;
};

struct Trial {
  PlantParameters plant;
  TrialDisturbance disturbance;
  control::ReferenceTrajectory reference;
};

// `period_s` and `arming_s` are the law's. Muscle coefficients carry the tolerances of b and b1:
// b ∝ k1 ε0² + k2 ε0 + k3 and b1 ∝ 2 k1 ε0 + k2, so the nonlinear plant (3) has exactly these.
Trial draw_trial(const Campaign& campaign, std::uint64_t index, double period_s, double arming_s);

}  // namespace eampc::law_design
