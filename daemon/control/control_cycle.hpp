// One control period, pure: encoder frame in → valve frame out, in the order
//   encoder_codec → state_estimator → disturbance_estimator → explicit_law → safety → valve_codec.
// No clock, heap, I/O or throw. Who calls it decides when a period is over and says so by handing in a frame or none.
#pragma once

#include <cstdint>

#include "control/controller_config.hpp"
#include "control/reference_trajectory.hpp"

namespace eampc::control {

struct CycleInput {
  const Frame* encoder_frame = nullptr;  // nullptr: the period passed without one
  OperatorAction action = OperatorAction::kNone;
  const ReferenceTrajectory* new_reference = nullptr;  // replaces the present one
  bool send_failed = false;  // the command frame of the last cycle was refused by the bus
};

// What one cycle saw and did: the source of telemetry, logs and tests. Trivially copyable.
struct CycleRecord {
  std::int64_t cycle = 0;
  double scenario_time_s = 0.0;  // since ACTIVE began; negative before
  EncoderSample sample;
  StateEstimate state;
  DisturbanceEstimate disturbance;
  Reference reference;
  LawOutput law;
  ValveVoltages valves;  // as they stand in the frame (rounded to its resolution)
  Mode mode = Mode::kInit;
  Fault fault = Fault::kNone;
  std::uint32_t limits = kLimitNone;
};

struct CycleOutput {
  Frame command;  // always to be sent, whatever the mode
  CycleRecord record;
};

// The members (one object per stage) are the implementer's; this is the interface the loop, the simulator and
// the tests rely on.
class ControlCycle {
 public:
  explicit ControlCycle(const ControllerConfig& config) noexcept;  // keeps a reference

  CycleOutput step(const CycleInput& input) noexcept;

  Mode mode() const noexcept;
  // True when SIGTERM may end the process: outputs are at the safe value.
  bool at_rest() const noexcept;
};

}  // namespace eampc::control
