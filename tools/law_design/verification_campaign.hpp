// Monte-Carlo of the closed loop: the daemon's own control cycle against random nonlinear plants,
// frame by frame, with the operator's sequence of a run on the bus (DISARMED, arm, ramp, ACTIVE).
// In: the law's configuration, a campaign, a range of trial indices → out: one row per trial.
// A row depends on the campaign and the index alone: not on threads, not on the range.
#pragma once

#include <cstdint>
#include <vector>

#include "control/controller_config.hpp"
#include "law_design/closed_loop_simulation.hpp"
#include "law_design/parallel_range.hpp"
#include "law_design/verification_trial.hpp"

namespace eampc::law_design {

// What one trial did. Maxima and counts are of the cycles from ACTIVE on; the voltages are checked
// in every frame, those before ACTIVE too.
struct TrialOutcome {
  std::uint64_t index = 0;
  double angle_rad = 0.0;             // largest |θ|, within the periods too
  double velocity_rad_s = 0.0;        // largest |θ̇|
  double tracking_error_rad = 0.0;    // largest |θ − y_r| in the last quarter
  double rms_error_rad = 0.0;         // of the same in the whole run
  std::int64_t angle_violations = 0;  // cycles beyond the law's state bounds
  std::int64_t velocity_violations = 0;
  std::int64_t range_violations = 0;    // frames with a voltage outside [min_V, max_V]
  std::int64_t slew_violations = 0;     // frames further from the last than slew_max_V_per_s · T
  std::int64_t non_finite = 0;          // cycles with a state or control that is not a number
  std::int64_t outside_box = 0;         // cycles with a parameter clamped onto the law's box
  std::int64_t saturated = 0;           // cycles with u at an end of its range
  std::int64_t fault = 0;               // control::Fault at the end
  std::int64_t closed_loop_cycles = 0;  // in ACTIVE
  std::int64_t cycles = 0;              // all
};

// `history`: nullptr, or where each cycle is appended.
TrialOutcome run_trial(const control::ControllerConfig& config, const Campaign& campaign,
                       std::uint64_t index, std::vector<SimulatedCycle>* history);

struct CampaignRun {
  std::vector<TrialOutcome> outcomes;  // in the order of the indices
  double thread_seconds = 0.0;         // processor time of all threads together
};

// Trials first .. first + count − 1. `threads` 0: one per core. `progress` is called some ten times
// a second. Throws Cancelled if it returned false.
CampaignRun run_campaign(const control::ControllerConfig& config, const Campaign& campaign,
                         std::uint64_t first, int count, int threads, const LoopProgress& progress);

}  // namespace eampc::law_design
