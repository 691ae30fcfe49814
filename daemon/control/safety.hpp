// Stage 5. In: verdict on the sample, operator edge, the law's u → out: mode, and both voltages
// with their windows (V).
//
//   INIT ──first valid sample──> DISARMED ──arm──> ARMING ──ramp over──> ACTIVE
//                                   ^  ^             │ disarm              │ disarm, fault
//                                   │  └─────── SOFT_STOP <────────────────┘
//                                   │              │ with a fault
//                                   └──reset── FAULT (latched)
//
// Up only by an operator's edge, down by itself, never an automatic resume. Two halves of one
// cycle: `advance` before the estimators (who is in charge, what time is it), `decide` after the
// law (finite check, box clamp, slew limit: the last lines before the wire). DISARMED and FAULT
// send valve.safe_V with the enable bit 0 at once, whatever the slew limit. Cost: constant. Absent:
// any clock (time is counted in periods), any opinion on the law's tuning.
#pragma once

#include "control/bus_health.hpp"
#include "control/controller_config.hpp"

namespace eampc::control {

struct SafetyInput {
  SampleVerdict verdict = SampleVerdict::kMissing;
  OperatorAction action = OperatorAction::kNone;
  BusHealth bus;
  // 0: a repeated frame, or one whose period was already counted as empty; more than 1: the counter
  // told of lost frames.
  std::int32_t elapsed_periods = 1;
};

struct SafetyState {
  Mode mode = Mode::kInit;
  Fault fault = Fault::kNone;
  bool entered_active = false;    // ACTIVE began in this cycle
  double scenario_time_s = -1.0;  // since ACTIVE began; −1 outside ACTIVE
};

struct SafetyDecision {
  ValveDemand demand;
  std::uint32_t limits = kLimitNone;
};

class Safety {
 public:
  explicit Safety(const ControllerConfig& config) noexcept;

  SafetyState advance(const SafetyInput& input) noexcept;

  // `law` is read in ACTIVE only. A value that is not finite is a fault of this very cycle: read
  // state() again.
  SafetyDecision decide(const StateEstimate& state, const DisturbanceEstimate& disturbance,
                        const LawOutput& law) noexcept;

  // The voltages as they stand in the frame: where ramps and the slew limit go on from.
  void sent(const ValveVoltages& voltages) noexcept { last_ = voltages; }

  SafetyState state() const noexcept;

 private:
  enum class Phase : std::uint8_t { kHold, kToBias, kVent };

  bool moving() const noexcept;
  void raise(Fault fault) noexcept;
  void begin_stop(Phase phase) noexcept;
  void continue_stop() noexcept;
  void obey(OperatorAction action) noexcept;
  Fault fault_of_silence() const noexcept;
  ValveVoltages ramp_towards(double target_V, std::int32_t periods) const noexcept;
  ValveVoltages stop_voltages() const noexcept;

  const ControllerConfig& config_;
  // Ramps and the time-out in periods, rounded to nearest.
  std::int32_t arming_periods_;
  std::int32_t stop_periods_;
  std::int32_t timeout_periods_;

  Mode mode_ = Mode::kInit;
  Fault fault_ = Fault::kNone;
  bool entered_active_ = false;
  bool same_period_ = false;  // no period passed since the last command
  std::int64_t active_periods_ = 0;
  Phase phase_ = Phase::kToBias;
  std::int32_t ramp_period_ = 0;  // 1 in the first cycle of a ramp
  ValveVoltages ramp_start_;
  ValveVoltages last_;
  ValveVoltages period_start_;  // last_ when the present period began
  std::int32_t periods_without_sample_ = 0;
  SampleVerdict verdict_since_sample_ = SampleVerdict::kMissing;
  std::int32_t refused_frames_ = 0;
};

}  // namespace eampc::control
