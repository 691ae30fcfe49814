// The reference joint with every message of the fault matrix on its bus, closed over the linear
// model, and a switch per fault: what is wrong, for the tests of detection and reaction. Every
// frame is checked as the valve node would see it. Stop and arming ramps of ten periods, reduced
// limits for ten more.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include "control/control_cycle.hpp"
#include "control/reference_joint.hpp"

namespace eampc::control {

inline SignalLayout unsigned_bits(int start_bit, int length, double factor = 1.0) {
  SignalLayout layout;
  layout.present = true;
  layout.start_bit = start_bit;
  layout.length = length;
  layout.factor = factor;
  return layout;
}

// Cycles from the first in which the fault holds to the one that reports it, both counted, at 5 ms:
// from the thresholds in monitored_joint().
inline int detection_cycles(Fault fault) {
  switch (fault) {
    case Fault::kEncoderTimeout:
      return 4;  // 20 ms
    case Fault::kEncoderCrc:
    case Fault::kEncoderLength:
    case Fault::kEncoderOutOfRange:
      return 3;  // frames
    case Fault::kEncoderFrozen:
      return 5;  // one repetition is forgiven, then 20 ms
    case Fault::kErrorPassive:
      return 10;  // 50 ms
    case Fault::kSendRefused:
      return 2;  // frames
    case Fault::kHeartbeatLost:
      return 15;  // 75 ms
    case Fault::kSupplyPressure:
      return 10;  // 50 ms
    default:
      return 1;
  }
}

inline ReferenceJoint monitored_joint() {
  ReferenceJoint joint = reference_joint();
  connect(joint);
  ControllerConfig& c = joint.config;
  c.encoder.angle.minimum = -12.56;
  c.encoder.angle.maximum = 12.56;
  c.valve.slew_max_V_per_s = 300.0;  // 1.5 V per period
  SafetyConfig& s = c.safety;
  s.arming_ramp_s = 0.05;
  s.reduced_limits_s = 0.05;
  s.reduced_control_share = 0.5;
  s.reduced_slew_V_per_s = 100.0;
  s.soft_stop_ramp_s = 0.05;
  s.encoder_invalid_frames = 3;
  s.encoder_frozen_s = 0.1;
  s.encoder_jump_velocity_rad_s = 18.0;
  s.encoder_counter_gap_max = 1;
  s.encoder_status_mask = 0x6;
  s.error_passive_s = 0.05;
  s.heartbeat_timeout_s = 0.075;
  s.supply_pressure_min_kPa = 700.0;
  s.supply_pressure_max_kPa = 1200.0;
  s.supply_pressure_s = 0.05;
  s.deadline_overruns_max = 20;

  c.valve_feedback.present = true;
  c.valve_feedback.id = 0x182;
  c.valve_feedback.supply_pressure = unsigned_bits(32, 16, 0.1);
  c.heartbeat.present = true;
  c.heartbeat.id = 0x701;
  c.heartbeat.length = 1;
  c.heartbeat.state = unsigned_bits(0, 8);
  c.emergency.present = true;
  c.emergency.id = 0x81;
  c.emergency.error_code = unsigned_bits(0, 16);
  c.e_stop.present = true;
  c.e_stop.id = 0x10;
  c.e_stop.length = 1;
  c.e_stop.stop = unsigned_bits(0, 1);
  c.identity.present = true;
  c.identity.id = 0x281;
  c.identity.length = 4;
  c.identity.inputs_crc32 = unsigned_bits(0, 32);
  c.inputs_crc32 = 0xC0FFEE00;
  return joint;
}

class MatrixBench {
 public:
  static constexpr double kSlewPerPeriod_V = 1.5;

  MatrixBench() : joint_(monitored_joint()) { restart(); }

  ControllerConfig& config() { return joint_.config; }

  void restart() {
    cycle_ = std::make_unique<ControlCycle>(joint_.config);
    x_ = StateVector::Zero();
    counter_ = 0;
    period_ = 0;
    wrong_ = Fault::kNone;
    last_ = {};
    reference_ = {};
    frozen_frame_ = {};
    reference_set_ = true;
  }

  // From now on this is wrong; kNone: everything is right again.
  void set_wrong(Fault fault) {
    wrong_ = fault;
    onset_ = true;
  }

  void set_reference(double angle_rad) {
    reference_.amplitude_rad = angle_rad;
    reference_set_ = false;
  }

  // One period, the frame checked: decodable, in the box, within one slew step while enabled, safe
  // while not.
  CycleRecord step(OperatorAction action = OperatorAction::kNone) {
    send_monitored();
    Frame frame = encoder_frame();
    CycleInput input;
    input.encoder_frame = wrong_ == Fault::kEncoderTimeout ? nullptr : &frame;
    input.action = action;
    input.bus = bus_health();
    ReferenceTrajectory reference = reference_;
    if (wrong_ == Fault::kNotFinite) {
      reference.amplitude_rad = std::numeric_limits<double>::quiet_NaN();
      reference_set_ = false;
    } else if (onset_) {
      reference_set_ = false;
    }
    if (!reference_set_) input.new_reference = &reference;
    reference_set_ = true;
    onset_ = false;
    const CycleOutput output = cycle_->step(input);
    check(output);
    x_ = StateVector(joint_.config.model.A_star * x_ + joint_.config.model.B_star * control_);
    ++period_;
    return output.record;
  }

  CycleRecord steps(int count) {
    CycleRecord record;
    for (int i = 0; i < count; ++i) record = step();
    return record;
  }

  // A fresh machine in this mode; `reduced`: ARMING's second part, in which the law acts.
  void go(Mode mode, bool reduced = false) {
    restart();
    if (mode == Mode::kInit) return;
    set_reference(0.3);
    steps(5);
    if (mode == Mode::kDisarmed) return;
    step(OperatorAction::kArm);
    steps(mode == Mode::kArming && !reduced ? 3 : 12);
    if (mode == Mode::kArming) return;
    steps(60);
    if (mode == Mode::kActive) return;
    if (mode == Mode::kSoftStop) {
      step(OperatorAction::kDisarm);
      step();
      return;
    }
    // FAULT by a cause that leaves nothing behind.
    set_wrong(Fault::kBusOff);
    step();
    set_wrong(Fault::kNone);
    steps(60);
  }

  const ValveVoltages& last() const { return last_; }
  bool at_rest() const { return cycle_->at_rest(); }
  int frames_checked() const { return frames_checked_; }

 private:
  void send_monitored() {
    const ControllerConfig& c = joint_.config;
    if (period_ % 5 == 0 && wrong_ != Fault::kHeartbeatLost) send(c.heartbeat, {5});
    const int supply_dPa = wrong_ == Fault::kSupplyPressure ? 4000 : 10000;
    send(c.valve_feedback, {0, 0, 0, 0, static_cast<std::uint8_t>(supply_dPa & 0xFF),
                            static_cast<std::uint8_t>(supply_dPa >> 8)});
    const bool alarm = wrong_ == Fault::kEmergencyMessage;
    if (onset_) send(c.emergency, {0, static_cast<std::uint8_t>(alarm ? 0x10 : 0)});
    if (period_ % 10 == 0 || onset_) {
      send(c.e_stop, {static_cast<std::uint8_t>(wrong_ == Fault::kEStop)});
      const std::uint8_t third = wrong_ == Fault::kLawMismatch ? 0x01 : 0xFF;
      send(c.identity, {0x00, 0xEE, third, 0xC0});
    }
  }

  void send(const MonitoredLayout& layout, const std::array<std::uint8_t, 8>& data) {
    Frame frame;
    frame.id = layout.id;
    frame.length = static_cast<std::uint8_t>(layout.length);
    frame.data = data;
    cycle_->observe(frame);
  }

  Frame encoder_frame() {
    if (wrong_ == Fault::kEncoderCounterGap && onset_) counter_ += 2;
    if (wrong_ == Fault::kEncoderFrozen && frozen_frame_.id != 0) return frozen_frame_;
    double angle_rad = x_[0];
    if (wrong_ == Fault::kEncoderOutOfRange) angle_rad = 13.0;
    if (wrong_ == Fault::kEncoderJump && onset_) angle_rad += 0.5;
    Frame frame = encode_encoder_frame(joint_.config.encoder, angle_rad, x_[1], counter_++,
                                       wrong_ == Fault::kEncoderStatus ? 0x4u : 0x1u);
    if (wrong_ == Fault::kEncoderCrc) frame.data[7] ^= 0x55;
    if (wrong_ == Fault::kEncoderLength) frame.length = 7;
    frozen_frame_ = frame;
    return frame;
  }

  BusHealth bus_health() const {
    BusHealth bus;
    bus.queue_proved_empty = true;
    bus.bus_off = wrong_ == Fault::kBusOff;
    bus.error_passive = wrong_ == Fault::kErrorPassive;
    bus.link_down = wrong_ == Fault::kLinkDown;
    bus.send_refused = wrong_ == Fault::kSendRefused;
    bus.unconfirmed_periods = wrong_ == Fault::kTxUnconfirmed ? 2 : 0;
    bus.deadline_overruns = wrong_ == Fault::kDeadlineOverruns && onset_ ? 21 : 0;
    return bus;
  }

  void check(const CycleOutput& output) {
    ValveVoltages v;
    ASSERT_TRUE(decode_valve_frame(joint_.config.valve_command, output.command, v));
    ASSERT_TRUE(v.u1_V >= 0.0 && v.u1_V <= 10.0 && v.u2_V >= 0.0 && v.u2_V <= 10.0);
    const Mode mode = output.record.mode;
    const bool rests = mode == Mode::kInit || mode == Mode::kDisarmed || mode == Mode::kFault;
    ASSERT_EQ(v.enable, !rests) << mode_text(mode);
    if (v.enable) {
      ASSERT_LE(std::abs(v.u1_V - last_.u1_V), kSlewPerPeriod_V + 1e-9);
      ASSERT_LE(std::abs(v.u2_V - last_.u2_V), kSlewPerPeriod_V + 1e-9);
    } else {
      ASSERT_TRUE(v.u1_V == 0.0 && v.u2_V == 0.0);
    }
    last_ = v;
    control_ = (v.u1_V - v.u2_V) / (2.0 * joint_.config.valve.control_gain_V);
    ++frames_checked_;
  }

  ReferenceJoint joint_;
  std::unique_ptr<ControlCycle> cycle_;
  StateVector x_ = StateVector::Zero();
  double control_ = 0.0;
  std::uint64_t counter_ = 0;
  std::int64_t period_ = 0;
  Fault wrong_ = Fault::kNone;
  bool onset_ = false;
  Frame frozen_frame_;
  ValveVoltages last_;
  ReferenceTrajectory reference_;
  bool reference_set_ = true;
  int frames_checked_ = 0;
};

}  // namespace eampc::control
