// In: causes that hold, operator's edge, periods passed → out: mode, latched fault, why an edge was
// refused.
//
//   INIT ──first valid sample──> DISARMED ──arm──> ARMING ──arming over──> ACTIVE
//                                   ^  ^             │ disarm, fault          │ disarm, fault
//                                   │  └─────── SOFT_STOP <───────────────────┘
//                                   │              │ with a fault
//                                   └──reset── FAULT (latched)
//
// Up only by an operator's edge, down by itself, never an automatic resume. The first cause stands
// until reset; a later one only makes the stop stronger (saturate < soft_stop < vent_ramp <
// immediate); one that begins before the law commanded the valves only vents. At rest nothing is
// latched: what is wrong there keeps the joint from being armed. Cost: constant. Absent: what a
// cause is (fault_detection), voltages' limits (voltage_guard).
#pragma once

#include "control/arming.hpp"
#include "control/controller_config.hpp"
#include "control/stop_ramp.hpp"

namespace eampc::control {

class ModeMachine {
 public:
  explicit ModeMachine(const ControllerConfig& config) noexcept;

  // `last`: the command before this cycle, where ramps begin.
  void advance(FaultSet present, OperatorAction action, bool sample_is_valid,
               bool queue_proved_empty, std::int32_t elapsed_periods,
               const ValveVoltages& last) noexcept;
  // A cause that only the law brought to light, in this very cycle.
  void raise(FaultSet present, const ValveVoltages& last) noexcept;

  Mode mode() const noexcept { return mode_; }
  Fault fault() const noexcept { return fault_; }
  Refusal refusal() const noexcept { return refusal_; }
  Fault refusal_cause() const noexcept { return refusal_cause_; }
  bool law_acts() const noexcept {
    return mode_ == Mode::kActive || (mode_ == Mode::kArming && arming_.law_acts());
  }
  bool limits_are_reduced() const noexcept { return mode_ == Mode::kArming && arming_.law_acts(); }
  std::int64_t active_periods() const noexcept { return active_periods_; }  // 0 in ACTIVE's first

  // In ARMING before the law acts, and in SOFT_STOP.
  ValveVoltages ramp_voltages() const noexcept {
    return mode_ == Mode::kArming ? arming_.voltages() : stop_.voltages();
  }

 private:
  bool moving() const noexcept {
    return mode_ == Mode::kArming || mode_ == Mode::kActive || mode_ == Mode::kSoftStop;
  }
  void let_time_pass(std::int32_t elapsed_periods) noexcept;
  void obey(OperatorAction action, FaultSet present, bool queue_proved_empty,
            const ValveVoltages& last) noexcept;
  void arm(FaultSet present, bool queue_proved_empty, const ValveVoltages& last) noexcept;
  void reset(FaultSet present) noexcept;
  void begin_stop(StopAction action, const ValveVoltages& last) noexcept;
  void rest_if_stopped() noexcept;
  void refuse(Refusal refusal, Fault cause = Fault::kNone) noexcept {
    refusal_ = refusal;
    refusal_cause_ = cause;
  }

  const ControllerConfig& config_;
  Arming arming_;
  StopRamp stop_;
  Mode mode_ = Mode::kInit;
  bool law_commanded_ = false;  // the command before this cycle; in a stop, the one before it
  Fault fault_ = Fault::kNone;
  Refusal refusal_ = Refusal::kNone;
  Fault refusal_cause_ = Fault::kNone;
  std::int64_t active_periods_ = 0;
};

}  // namespace eampc::control
