#include "control/fault.hpp"

namespace eampc::control {
namespace {

struct FaultWords {
  const char* name;
  const char* text;
};

constexpr std::array<FaultWords, kFaultCount> kWords{{
    {"none", "none"},
    {"encoder_timeout", "no encoder frame within the time-out (safety.encoder_timeout_s)"},
    {"encoder_crc", "encoder frames with a wrong CRC (safety.encoder_invalid_frames)"},
    {"encoder_length", "encoder frames of a wrong length (safety.encoder_invalid_frames)"},
    {"encoder_out_of_range",
     "encoder values outside the range of the DBC (safety.encoder_invalid_frames)"},
    {"encoder_frozen",
     "the encoder repeats itself although the valves move the joint (safety.encoder_frozen_s)"},
    {"encoder_jump", "implausible jump of the encoder's angle (safety.encoder_jump_margin_rad)"},
    {"encoder_counter_gap",
     "encoder frames lost by their counter (safety.encoder_counter_gap_max)"},
    {"encoder_status", "the encoder reports a failure (safety.encoder_status_mask)"},
    {"not_finite", "estimate or control not finite (safety.not_finite_action)"},
    {"bus_off", "the CAN controller is bus-off (safety.bus_off_action)"},
    {"error_passive", "the CAN controller is error-passive (safety.error_passive_s)"},
    {"tx_unconfirmed", "a command waits for its confirmation (safety.tx_unconfirmed_periods)"},
    {"link_down", "the CAN interface is down or gone (safety.link_down_action)"},
    {"send_refused", "the bus refuses command frames (safety.send_refused_frames)"},
    {"heartbeat_lost", "no heartbeat of the node (safety.heartbeat_timeout_s)"},
    {"emergency_message", "emergency message of the node (bus.emergency)"},
    {"supply_pressure",
     "supply pressure out of range or unknown (safety.supply_pressure_min_kPa, max_kPa)"},
    {"deadline_overruns", "too many missed deadlines (safety.deadline_overruns_max)"},
    {"e_stop",
     "emergency stop pressed, or its node is silent (bus.e_stop, safety.e_stop_timeout_s)"},
    {"law_mismatch", "the law was designed for another rig (bus.identity)"},
}};

// Causes that bring others with them come first.
constexpr std::array kOrder{
    Fault::kEStop,          Fault::kLawMismatch,       Fault::kLinkDown,
    Fault::kBusOff,         Fault::kTxUnconfirmed,     Fault::kSendRefused,
    Fault::kErrorPassive,   Fault::kEmergencyMessage,  Fault::kHeartbeatLost,
    Fault::kSupplyPressure, Fault::kEncoderStatus,     Fault::kEncoderLength,
    Fault::kEncoderCrc,     Fault::kEncoderOutOfRange, Fault::kEncoderFrozen,
    Fault::kEncoderJump,    Fault::kEncoderCounterGap, Fault::kEncoderTimeout,
    Fault::kNotFinite,      Fault::kDeadlineOverruns,
};
static_assert(kOrder.size() == kFaultCount - 1);

}  // namespace

Fault FaultSet::first() const noexcept {
  for (const Fault fault : kOrder) {
    if (has(fault)) return fault;
  }
  return Fault::kNone;
}

const char* fault_name(Fault fault) noexcept {
  const auto number = static_cast<std::size_t>(fault);
  return number < kFaultCount ? kWords[number].name : "unknown";
}

const char* fault_text(Fault fault) noexcept {
  const auto number = static_cast<std::size_t>(fault);
  return number < kFaultCount ? kWords[number].text : "unknown";
}

const char* refusal_text(Refusal refusal) noexcept {
  switch (refusal) {
    case Refusal::kNone:
      return "none";
    case Refusal::kFaultLatched:
      return "a fault is latched; run `eampc reset` first";
    case Refusal::kCausePresent:
      return "the cause of a fault persists";
    case Refusal::kQueueNotProvedEmpty:
      return "an old command may still wait in the interface's queue; restart the interface";
    case Refusal::kNotAtRest:
      return "the joint is still coming to rest";
    case Refusal::kNoEncoderFrame:
      return "no valid encoder frame was seen yet; is the encoder on?";
    case Refusal::kAlreadyArmed:
      return "the joint is armed already";
  }
  return "unknown";
}

const char* action_name(StopAction action) noexcept {
  switch (action) {
    case StopAction::kSaturate:
      return "saturate";
    case StopAction::kSoftStop:
      return "soft_stop";
    case StopAction::kVentRamp:
      return "vent_ramp";
    case StopAction::kImmediate:
      return "immediate";
  }
  return "unknown";
}

}  // namespace eampc::control
