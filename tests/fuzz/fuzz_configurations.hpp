// Controllers that a fuzz target runs: the smallest ones that differ in what the cycle does with a
// frame. Short ramps: a
// case must be able to see the end of each.
#pragma once

#include <algorithm>
#include <deque>

#include "control/reference_joint.hpp"

namespace eampc::fuzz {

// With CRC, counter and status on every frame, with a slew limit; without any; position only with
// the Kalman filter; the valve state in the model or not.
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
