#include "control/mode_machine.hpp"

#include <algorithm>

namespace eampc::control {

ModeMachine::ModeMachine(const ControllerConfig& config) noexcept
    : config_(config), arming_(config), stop_(config) {}

void ModeMachine::advance(FaultSet present, OperatorAction action, bool sample_is_valid,
                          bool queue_proved_empty, std::int32_t elapsed_periods,
                          const ValveVoltages& last) noexcept {
  if (mode_ == Mode::kInit && sample_is_valid) mode_ = Mode::kDisarmed;
  if (mode_ != Mode::kSoftStop) law_commanded_ = law_acts();
  let_time_pass(elapsed_periods);
  raise(present, last);
  obey(action, present, queue_proved_empty, last);
  if (mode_ == Mode::kArming && arming_.done()) {
    mode_ = Mode::kActive;
    active_periods_ = arming_.periods_beyond();
  }
}

void ModeMachine::let_time_pass(std::int32_t elapsed_periods) noexcept {
  if (mode_ == Mode::kActive) {
    active_periods_ += elapsed_periods;
  } else if (mode_ == Mode::kArming) {
    arming_.advance(elapsed_periods);
  } else if (mode_ == Mode::kSoftStop) {
    stop_.advance(elapsed_periods);
    rest_if_stopped();
  }
}

void ModeMachine::raise(FaultSet present, const ValveVoltages& last) noexcept {
  if (!moving() || present.empty()) return;
  if (fault_ == Fault::kNone) fault_ = present.first();
  StopAction strongest = StopAction::kSaturate;
  for (std::size_t number = 1; number < kFaultCount; ++number) {
    const auto fault = static_cast<Fault>(number);
    if (present.has(fault)) strongest = std::max(strongest, config_.safety.actions[fault]);
  }
  if (strongest == StopAction::kImmediate) {
    mode_ = Mode::kFault;
  } else if (mode_ != Mode::kSoftStop || strongest > stop_.phase()) {
    begin_stop(strongest, last);
  }
}

void ModeMachine::begin_stop(StopAction action, const ValveVoltages& last) noexcept {
  // Below the bias a soft stop, and the one that ends a hold, would add pressure on the way down.
  stop_.begin(law_commanded_ ? action : StopAction::kVentRamp, last);
  mode_ = Mode::kSoftStop;
  rest_if_stopped();
}

void ModeMachine::rest_if_stopped() noexcept {
  if (stop_.done()) mode_ = fault_ == Fault::kNone ? Mode::kDisarmed : Mode::kFault;
}

void ModeMachine::obey(OperatorAction action, FaultSet present, bool queue_proved_empty,
                       const ValveVoltages& last) noexcept {
  switch (action) {
    case OperatorAction::kArm:
      arm(present, queue_proved_empty, last);
      break;
    case OperatorAction::kDisarm:
      refuse(Refusal::kNone);
      if (mode_ == Mode::kActive || mode_ == Mode::kArming) begin_stop(StopAction::kSoftStop, last);
      break;
    case OperatorAction::kReset:
      reset(present);
      break;
    case OperatorAction::kNone:
      break;
  }
}

void ModeMachine::arm(FaultSet present, bool queue_proved_empty,
                      const ValveVoltages& last) noexcept {
  switch (mode_) {
    case Mode::kInit:
      return refuse(Refusal::kNoEncoderFrame);
    case Mode::kArming:
    case Mode::kActive:
      return refuse(Refusal::kAlreadyArmed);
    case Mode::kSoftStop:
      return refuse(Refusal::kNotAtRest);
    case Mode::kFault:
      return refuse(Refusal::kFaultLatched, fault_);
    case Mode::kDisarmed:
      break;
  }
  if (!present.empty()) return refuse(Refusal::kCausePresent, present.first());
  if (!queue_proved_empty) return refuse(Refusal::kQueueNotProvedEmpty);
  refuse(Refusal::kNone);
  mode_ = Mode::kArming;
  arming_.begin(last);
}

void ModeMachine::reset(FaultSet present) noexcept {
  if (mode_ == Mode::kSoftStop && fault_ != Fault::kNone) return refuse(Refusal::kNotAtRest);
  if (mode_ != Mode::kFault) return refuse(Refusal::kNone);
  if (present.has(fault_)) return refuse(Refusal::kCausePresent, fault_);
  refuse(Refusal::kNone);
  mode_ = Mode::kDisarmed;
  fault_ = Fault::kNone;
}

}  // namespace eampc::control
