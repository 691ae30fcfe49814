// Stage 5. In: encoder and monitored samples, the bus's health, operator's edge, the law's u → out:
// mode, and both voltages with their windows (V). Its parts, in the order of the data flow:
//
//   fault_detection (encoder_supervision, overrun_window) → mode_machine (arming, stop_ramp) →
//   voltage_guard
//
// Two halves of one cycle: `advance` before the estimators (who is in charge, what time is it),
// `decide` after the law (finite check, box clamp, slew limit: the last lines before the wire).
// DISARMED and FAULT send valve.safe_V with the enable bit 0 at once, whatever the slew limit.
// Cost: constant. Absent: any clock (time is counted in periods), any opinion on the law's tuning.
#pragma once

#include "control/bus_health.hpp"
#include "control/controller_config.hpp"
#include "control/fault_detection.hpp"
#include "control/mode_machine.hpp"
#include "control/voltage_guard.hpp"

namespace eampc::control {

struct SafetyInput {
  MonitorSample monitor;
  BusHealth bus;
  OperatorAction action = OperatorAction::kNone;
  // 0: a repeated frame, or one whose period was already counted as empty; more than 1: the counter
  // told of lost frames.
  std::int32_t elapsed_periods = 1;
};

struct SafetyState {
  Mode mode = Mode::kInit;
  Fault fault = Fault::kNone;
  FaultSet present_faults;  // causes that hold, latched or not
  Refusal refusal = Refusal::kNone;
  Fault refusal_cause = Fault::kNone;
  bool law_acts = false;
  bool law_begins = false;        // law_acts became true in this cycle
  double scenario_time_s = -1.0;  // since ACTIVE began; −1 outside ACTIVE
};

struct SafetyDecision {
  ValveDemand demand;
  std::uint32_t limits = kLimitNone;
};

class Safety {
 public:
  explicit Safety(const ControllerConfig& config) noexcept;

  // An implausible sample gets its verdict here, before an estimator believes it.
  SafetyState advance(const SafetyInput& input, EncoderSample& sample) noexcept;

  // `law` is read while it acts only. What is not finite is a fault of this very cycle: read
  // state() again.
  SafetyDecision decide(const StateEstimate& state, const DisturbanceEstimate& disturbance,
                        const LawOutput& law) noexcept;

  // The voltages as they stand in the frame.
  void sent(const ValveVoltages& voltages) noexcept { guard_.sent(voltages); }

  SafetyState state() const noexcept;

 private:
  ValveVoltages law_voltages(const LawOutput& law, std::uint32_t& limits) const noexcept;

  const ControllerConfig& config_;
  FaultDetection detection_;
  ModeMachine machine_;
  VoltageGuard guard_;
  FaultSet present_;
  bool law_begins_ = false;
  bool same_period_ = false;  // no period passed since the last command
};

}  // namespace eampc::control
