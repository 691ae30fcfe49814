// One control period, pure: encoder frame in → valve frame out, in the order
//   encoder_codec → state_estimator → disturbance_estimator → explicit_law → safety → valve_codec;
// frames of the monitored messages come in beside it, by observe().
// No clock, heap, I/O or throw. Who calls it decides when a period is over and says so by handing
// in a frame or none.
#pragma once

#include <cstdint>

#include "control/bus_health.hpp"
#include "control/controller_config.hpp"
#include "control/disturbance_estimator.hpp"
#include "control/encoder_codec.hpp"
#include "control/explicit_law.hpp"
#include "control/monitor_codec.hpp"
#include "control/nonblocking.hpp"
#include "control/reference_trajectory.hpp"
#include "control/safety.hpp"
#include "control/state_estimator.hpp"
#include "control/valve_codec.hpp"

namespace eampc::control {

struct CycleInput {
  const Frame* encoder_frame = nullptr;  // nullptr: the period passed without one
  OperatorAction action = OperatorAction::kNone;
  const ReferenceTrajectory* new_reference = nullptr;  // replaces the present one
  // Periods before this one that passed without a cycle, because nobody ran it for as long as
  // safety.encoder_timeout_s; otherwise 0. A counter that rolls over meanwhile hides them.
  std::int32_t starved_periods = 0;
  BusHealth bus;
};

// What one cycle saw and did: the source of telemetry, logs and tests. Trivially copyable.
struct CycleRecord {
  std::int64_t cycle = 0;
  double scenario_time_s = 0.0;  // since ACTIVE began; negative before
  EncoderSample sample;
  double pressure1_kPa = 0.0;  // newest feedback; 0 before the first
  double pressure2_kPa = 0.0;
  double supply_pressure_kPa = 0.0;
  BusHealth bus;
  StateEstimate state;
  DisturbanceEstimate disturbance;
  Reference reference;
  LawOutput law;
  ValveVoltages valves;  // as they stand in the frame (rounded to its resolution)
  Mode mode = Mode::kInit;
  Fault fault = Fault::kNone;
  FaultSet present_faults;             // causes that hold in this cycle, latched or not
  Refusal refusal = Refusal::kNone;    // of the last arm or reset that was not obeyed
  Fault refusal_cause = Fault::kNone;  // of kCausePresent and kFaultLatched
  std::uint32_t limits = kLimitNone;
};

struct CycleOutput {
  Frame command;  // always to be sent, whatever the mode
  CycleRecord record;
};

// One object per stage. Safety has two halves: who is in charge is settled before the estimators
// (an operator's edge takes effect in its own cycle), the voltages after the law.
class ControlCycle {
 public:
  explicit ControlCycle(const ControllerConfig& config) noexcept;  // keeps a reference

  // A frame of a monitored message (valve feedback, heartbeat, emergency, E-stop, identity), when
  // it arrives; it counts for the next step(). Any other frame is ignored.
  void observe(const Frame& frame) noexcept { monitor_codec_.observe(frame); }
  // At rest only: a node that starts anew in mid-motion would follow commands that are not for it.
  bool asks_for_start(const Frame& frame) const noexcept {
    return at_rest() && monitor_codec_.asks_for_start(frame);
  }

  // One call per period. A frame that repeats the last counter does not count as a period the first
  // time: the record keeps its cycle, the last decision is sent again.
  CycleOutput step(const CycleInput& input) noexcept EAMPC_NONBLOCKING;

  Mode mode() const noexcept;
  // True when SIGTERM may end the process: outputs are at the safe value.
  bool at_rest() const noexcept;

 private:
  // Beyond any rolling counter of up to 8 bits; a wider one that jumps further has restarted.
  static constexpr std::uint32_t kLongestCounterGap = 255;

  void count_silent_period() noexcept;
  std::int32_t elapsed_periods(const EncoderSample& sample) noexcept;
  std::int32_t end_starvation(EncoderSample& sample, std::int32_t starved_periods) noexcept;
  bool read_reference(double time_s, Reference& reference) const noexcept;

  const ControllerConfig& config_;
  EncoderCodec encoder_codec_;
  MonitorCodec monitor_codec_;
  StateEstimator state_estimator_;
  DisturbanceEstimator disturbance_estimator_;
  ExplicitLaw explicit_law_;
  Safety safety_;
  ValveCodec valve_codec_;

  ReferenceTrajectory trajectory_;
  StateEstimate state_;
  DisturbanceEstimate disturbance_;
  std::int64_t cycle_ = -1;  // the first period is cycle 0
  double u_sent_ = 0.0;
  double u_on_valves_ = 0.0;
  std::int32_t periods_without_sample_ = 0;
  std::int32_t periods_ahead_ = 0;  // counted as empty, their frames still to come by the counter
  bool predicted_ = false;          // the state was predicted since its last correction
  bool duplicate_before_ = false;   // the last frame was a repetition already
};

}  // namespace eampc::control
