// A control cycle whose every output is judged: the invariants of docs' safety section, written
// from the design and not from safety.cpp. In: any CycleInput → out: the cycle's output, or an
// abort that names the invariant.
#pragma once

#include <cmath>
#include <cstdlib>

#include "control/control_cycle.hpp"
#include "fuzz/fuzz_target.hpp"

namespace eampc::fuzz {

class CheckedCycle {
 public:
  explicit CheckedCycle(const control::ControllerConfig& config) noexcept
      : config_(config), cycle_(config), last_{config.valve.safe_V, config.valve.safe_V, false} {}

  control::CycleOutput step(const control::CycleInput& input) noexcept {
    const control::CycleOutput output = cycle_.step(input);
    check_frame(output);
    check_voltages(output.record);
    check_transition(output.record, input.action);
    check_record(output.record);
    last_ = output.record.valves;
    mode_ = output.record.mode;
    fault_ = output.record.fault;
    cycle_number_ = output.record.cycle;
    return output;
  }

  void observe(const control::Frame& frame) noexcept { cycle_.observe(frame); }
  control::Mode mode() const noexcept { return mode_; }

 private:
  using Mode = control::Mode;
  using Action = control::OperatorAction;

  static bool is_moving(Mode mode) noexcept {
    return mode == Mode::kArming || mode == Mode::kActive || mode == Mode::kSoftStop;
  }

  // What the valve node reads is what the record says.
  void check_frame(const control::CycleOutput& output) const noexcept {
    const control::ValveCommandLayout& layout = config_.valve_command;
    require(output.command.id == layout.id && output.command.extended == layout.extended &&
                !output.command.remote && output.command.length == layout.length,
            "the command frame has its own identifier and length");
    control::ValveVoltages read;
    require(control::decode_valve_frame(layout, output.command, read),
            "the valve node accepts the command frame");
    require(read.u1_V == output.record.valves.u1_V && read.u2_V == output.record.valves.u2_V,
            "the record holds the voltages of the frame");
    require(!layout.enable.present || read.enable == output.record.valves.enable,
            "the record holds the enable bit of the frame");
  }

  void check_voltages(const control::CycleRecord& record) const noexcept {
    const control::ValveConfig& valve = config_.valve;
    const control::ValveVoltages& now = record.valves;
    const double slew_V = valve.slew_max_V_per_s * config_.model.period_s;
    const auto check = [&](double voltage_V, double last_V, const control::SignalLayout& signal) {
      require(std::isfinite(voltage_V), "voltages are finite");
      // Limits that lie between two counts of the frame are met to one count.
      const double count_V = std::abs(signal.factor);
      require(voltage_V > valve.min_V - count_V && voltage_V < valve.max_V + count_V,
              "voltages lie inside valve.min_V and valve.max_V");
      if (now.enable) {
        require(std::abs(voltage_V - last_V) <= slew_V + count_V,
                "an enabled voltage moves by at most valve.slew_max_V_per_s");
      } else {
        require(std::abs(voltage_V - valve.safe_V) <= 0.5 * count_V + 1e-9,
                "a disabled node is told valve.safe_V");
      }
    };
    check(now.u1_V, last_.u1_V, config_.valve_command.u1);
    check(now.u2_V, last_.u2_V, config_.valve_command.u2);
    require(now.enable == is_moving(record.mode), "enabled exactly while the joint is moved");
  }

  void check_transition(const control::CycleRecord& record, Action action) const noexcept {
    const Mode from = mode_, to = record.mode;
    const bool rises = to == Mode::kArming || to == Mode::kActive;
    const bool rose = from == Mode::kArming || from == Mode::kActive;
    if (rises && !rose) {
      require(action == Action::kArm, "only an operator's edge arms");
      // A stop that ends in this very cycle is over: the edge finds DISARMED.
      require(from == Mode::kInit || from == Mode::kDisarmed ||
                  (from == Mode::kSoftStop && fault_ == control::Fault::kNone),
              "arming begins in DISARMED");
    }
    if (rises) require(record.fault == control::Fault::kNone, "nothing is armed with a fault");
    if (rises) require(action != Action::kDisarm, "a disarm is obeyed in its own cycle");
    if (from == Mode::kActive && to == Mode::kArming)
      require(false, "ACTIVE never falls to ARMING");
    if (to == Mode::kInit) require(from == Mode::kInit, "INIT is left once");
    if (from == Mode::kFault && to != Mode::kFault) {
      require(action == Action::kReset && to == Mode::kDisarmed,
              "FAULT is left by a reset only, to DISARMED only");
    }
    if (to == Mode::kFault) require(record.fault != control::Fault::kNone, "FAULT names its fault");
    if (fault_ != control::Fault::kNone && record.fault == control::Fault::kNone) {
      require(action == Action::kReset, "a fault is latched until a reset");
    }
  }

  void check_record(const control::CycleRecord& record) const noexcept {
    require(record.cycle >= cycle_number_, "the cycle number never falls");
    const bool at_rest = !is_moving(record.mode);
    require(cycle_.at_rest() == at_rest && cycle_.mode() == record.mode,
            "the cycle's own mode is the record's");
    if (record.mode == Mode::kActive) {
      require(record.law.region >= 0 && std::isfinite(record.law.u) &&
                  record.law.u >= config_.law.u_min && record.law.u <= config_.law.u_max,
              "in ACTIVE the law ran and is inside its range");
      for (const double x : record.state.x) require(std::isfinite(x), "x is finite in ACTIVE");
      require(std::isfinite(record.scenario_time_s) && record.scenario_time_s >= 0.0,
              "scenario time runs in ACTIVE");
      require(std::abs(record.reference.angle_rad) <= config_.safety.reference_angle_max_rad ||
                  config_.law.formulation == control::Formulation::kPaper,
              "the reference is clamped");
    }
  }

  const control::ControllerConfig& config_;
  control::ControlCycle cycle_;
  control::ValveVoltages last_;
  Mode mode_ = Mode::kInit;
  control::Fault fault_ = control::Fault::kNone;
  std::int64_t cycle_number_ = 0;
};

}  // namespace eampc::fuzz
