// Controllers that a fuzz target runs: the smallest ones that differ in what the cycle does with a
// frame. Short ramps: a
// case must be able to see the end of each.
#pragma once

#include <algorithm>
#include <deque>

#include "control/reference_joint.hpp"

namespace eampc::fuzz {

inline void monitor_everything(control::ControllerConfig& c) {
  static_cast<control::MonitoredLayout&>(c.valve_feedback) = {true, 0x182, false, 8, {}};
  c.valve_feedback.pressure1 = {true, 0, 16, true, false, 0.1, 0.0};
  c.valve_feedback.pressure2 = {true, 16, 16, true, false, 0.1, 0.0};
  c.valve_feedback.supply_pressure = {true, 32, 16, true, false, 0.1, 0.0};
  static_cast<control::MonitoredLayout&>(c.heartbeat) = {true, 0x701, false, 1, {}};
  c.heartbeat.state = {true, 0, 7, true, false, 1.0, 0.0};
  static_cast<control::MonitoredLayout&>(c.emergency) = {true, 0x81, false, 8, {}};
  c.emergency.error_code = {true, 0, 16, true, false, 1.0, 0.0};
  static_cast<control::MonitoredLayout&>(c.e_stop) = {true, 0x10, false, 1, {}};
  c.e_stop.stop = {true, 0, 8, true, false, 1.0, 0.0};
  static_cast<control::MonitoredLayout&>(c.identity) = {true, 0x183, false, 4, {}};
  c.identity.inputs_crc32 = {true, 0, 32, true, false, 1.0, 0.0};
  c.safety.encoder_frozen_s = 0.05;
  c.safety.encoder_jump_velocity_rad_s = 20.0;
  c.safety.encoder_status_mask = 0xf;
  c.safety.supply_pressure_min_kPa = 300.0;
}

// With CRC, counter and status on every frame, with a slew limit; without any; position only with
// the Kalman filter; the valve state in the model or
// not; every message monitored and every supervision on.
inline const std::deque<control::ReferenceJoint>& joints() {
  static const std::deque<control::ReferenceJoint> all = [] {
    std::deque<control::ReferenceJoint> joints;
    joints.push_back(control::reference_joint());
    joints.back().config.valve.slew_max_V_per_s = 100.0;

    joints.push_back(control::reference_joint(false));
    control::ControllerConfig& plain = joints.back().config;
    plain.encoder.counter = plain.encoder.status = {};
    plain.encoder.crc = {};
    plain.valve_command.counter = {};
    plain.valve_command.crc = {};
    plain.safety.arming_ramp_s = 0.0;
    plain.safety.soft_stop_ramp_s = 0.0;

    joints.push_back(control::reference_joint());
    control::ControllerConfig& kalman = joints.back().config;
    kalman.encoder.velocity = {};
    kalman.estimator.kind = control::EstimatorKind::kKalman;
    kalman.estimator.kalman_state_gain = {0.5, 20.0};
    kalman.estimator.kalman_disturbance_gain = 200.0;
    kalman.trigger_on_sync = true;

    joints.push_back(control::reference_joint());
    monitor_everything(joints.back().config);
    for (control::ReferenceJoint& joint : joints) {
      control::SafetyConfig& safety = joint.config.safety;
      safety.arming_ramp_s = std::min(safety.arming_ramp_s, 0.05);
      safety.soft_stop_ramp_s = std::min(safety.soft_stop_ramp_s, 0.05);
      control::connect(joint);
    }
    return joints;
  }();
  return all;
}

}  // namespace eampc::fuzz
