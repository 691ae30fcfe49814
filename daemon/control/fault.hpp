// Why the motion stops and how: causes with their numbers, the action on each, and why an arm or a
// reset was refused. Numbers and names are published and stay; a new cause takes the next number,
// its name and text in fault.cpp, its key in the rig file.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace eampc::control {

// fault_name() gives the name in rig files and reports, fault_text() a sentence with the key.
enum class Fault : std::uint8_t {
  kNone = 0,
  kEncoderTimeout = 1,
  kEncoderCrc = 2,
  kEncoderLength = 3,
  kEncoderOutOfRange = 4,
  kEncoderFrozen = 5,
  kEncoderJump = 6,
  kEncoderCounterGap = 7,
  kEncoderStatus = 8,
  kNotFinite = 9,
  kBusOff = 10,
  kErrorPassive = 11,
  kTxUnconfirmed = 12,
  kLinkDown = 13,
  kSendRefused = 14,
  kHeartbeatLost = 15,
  kEmergencyMessage = 16,
  kSupplyPressure = 17,
  kDeadlineOverruns = 18,
  kEStop = 19,
  kLawMismatch = 20,
};
inline constexpr std::size_t kFaultCount = 21;  // kNone included

// In rising strength: a stronger one cuts into a weaker one, never the other way round.
enum class StopAction : std::uint8_t {
  kSaturate,   // hold the last voltages for safety.soft_stop_ramp_s, then as kSoftStop
  kSoftStop,   // ramp both to valve.bias_V, then both to valve.safe_V
  kVentRamp,   // ramp both to valve.safe_V
  kImmediate,  // valve.safe_V and enable bit 0 in this very frame
};

// What to do on each cause, by its number.
struct FaultActions {
  std::array<StopAction, kFaultCount> of;

  constexpr StopAction operator[](Fault fault) const noexcept {
    return of[static_cast<std::size_t>(fault)];
  }
  constexpr StopAction& operator[](Fault fault) noexcept {
    return of[static_cast<std::size_t>(fault)];
  }
};

// The defaults of the rig file. A command that may not arrive, a stop button, and a law that is not
// the rig's: nothing but the safe value is right. Where the node or its air is in doubt: no way
// over the bias. Everything else: the soft stop, which needs neither encoder nor law.
constexpr FaultActions default_fault_actions() noexcept {
  FaultActions actions{};
  actions.of.fill(StopAction::kSoftStop);
  for (const Fault fault : {Fault::kBusOff, Fault::kTxUnconfirmed, Fault::kLinkDown,
                            Fault::kSendRefused, Fault::kEStop, Fault::kLawMismatch}) {
    actions[fault] = StopAction::kImmediate;
  }
  for (const Fault fault :
       {Fault::kHeartbeatLost, Fault::kEmergencyMessage, Fault::kSupplyPressure}) {
    actions[fault] = StopAction::kVentRamp;
  }
  return actions;
}

// Causes that hold at the same time, bit n for the cause of number n.
class FaultSet {
 public:
  constexpr void add(Fault fault, bool present = true) noexcept {
    if (present) bits_ |= std::uint32_t{1} << static_cast<unsigned>(fault);
  }
  constexpr bool has(Fault fault) const noexcept {
    return (bits_ >> static_cast<unsigned>(fault) & 1u) != 0;
  }
  constexpr bool empty() const noexcept { return bits_ == 0; }
  constexpr std::uint32_t bits() const noexcept { return bits_; }

  // The one that explains the others: a bus that is down also confirms nothing and brings no
  // encoder frame. kNone if the set is empty.
  Fault first() const noexcept;

 private:
  std::uint32_t bits_ = 0;
};

// Why an operator's edge was not obeyed.
enum class Refusal : std::uint8_t {
  kNone = 0,
  kFaultLatched = 1,         // arm: reset first
  kCausePresent = 2,         // arm, reset: a cause still holds; which one stands beside it
  kQueueNotProvedEmpty = 3,  // arm: an old command may still wait in the interface
  kNotAtRest = 4,            // arm, reset: the joint is still coming to rest
  kNoEncoderFrame = 5,       // arm: no valid encoder frame since the start
  kAlreadyArmed = 6,         // arm
};

const char* fault_name(Fault fault) noexcept;  // "encoder_timeout"
const char* fault_text(Fault fault) noexcept;  // "encoder time-out (safety.encoder_timeout_s)"
const char* refusal_text(Refusal refusal) noexcept;
const char* action_name(StopAction action) noexcept;  // as in the rig file

}  // namespace eampc::control
