// A controller configuration for tests, written by hand: the reference rig's numbers with the
// sampled model from Eigen's own matrix exponential (not from the design tools), one affine piece u
// = −K e + u_ss as law, and the reference frames.
#pragma once

#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "control/controller_config.hpp"
#include "one_piece_law.hpp"
#include "service/law_packing.hpp"

namespace eampc::control {

struct ReferenceJoint {
  std::vector<double> gain;  // u = gain·p + offset
  double offset = 0.0;
  ControllerConfig config;
  service::LawPacking packing;
};

// Signals of rigs/reference/reference.dbc.
inline void set_reference_frames(ControllerConfig& c) {
  c.encoder.id = 0x181;
  c.encoder.angle = {true, 0, 24, true, true, 2.0 * 3.14159265358979323846 / 131072.0, 0.0};
  c.encoder.velocity = {true, 24, 16, true, true, 0.0005, 0.0};
  c.encoder.counter = {true, 40, 4, true, false, 1.0, 0.0};
  c.encoder.status = {true, 44, 4, true, false, 1.0, 0.0};
  c.encoder.crc = {true, 7, 0x181};
  c.valve_command.id = 0x201;
  c.valve_command.u1 = {true, 0, 16, true, true, 0.001, 0.0};
  c.valve_command.u2 = {true, 16, 16, true, true, 0.001, 0.0};
  c.valve_command.enable = {true, 32, 1, true, false, 1.0, 0.0};
  c.valve_command.counter = {true, 36, 4, true, false, 1.0, 0.0};
  c.valve_command.crc = {true, 7, 0x201};
}

// A*, B*, D of [A B I; 0] in one exponential.
inline void set_sampled_model(DiscreteModel& m) {
  const int n = m.order;
  Eigen::MatrixXd block = Eigen::MatrixXd::Zero(2 * n + 1, 2 * n + 1);
  block.topLeftCorner(n, n) = m.A.topLeftCorner(n, n) * m.period_s;
  block.block(0, n, n, 1) = m.B.head(n) * m.period_s;
  block.block(0, n + 1, n, n) = Eigen::MatrixXd::Identity(n, n) * m.period_s;
  const Eigen::MatrixXd e = block.exp();
  m.A_star.topLeftCorner(n, n) = e.topLeftCorner(n, n);
  m.B_star.head(n) = e.block(0, n, n, 1);
  m.D.topRows(n) = e.block(0, n + 1, n, 2);
}

// b, b1, b2 of (9) worked out by hand from the reference rig's numbers:
//   b  = 2·0.09·0.45·0.025·(10000·0.01 − 7500·0.1 + 1600)/0.05 = 38.475
//   b1 = 2·0.09·5·0.025²·(2·10000·0.1 − 7500)/0.2/0.05 = −309.375
//   b2 = −0.5/0.05 = −10
inline ReferenceJoint reference_joint(bool valve_state = true) {
  ReferenceJoint joint;
  ControllerConfig& c = joint.config;
  c.model.period_s = 0.005;
  c.model.b = 38.475;
  c.model.b1 = -309.375;
  c.model.b2 = -10.0;
  c.model.order = valve_state ? 3 : 2;
  c.model.valve_time_constant_s = valve_state ? 0.03 : 0.0;
  c.model.A(0, 1) = 1.0;
  c.model.A(1, 0) = c.model.b1;
  c.model.A(1, 1) = c.model.b2;
  if (valve_state) {
    c.model.A(1, 2) = c.model.b;
    c.model.A(2, 2) = -1.0 / 0.03;
    c.model.B(2) = 1.0 / 0.03;
  } else {
    c.model.B(1) = c.model.b;
  }
  set_sampled_model(c.model);

  c.estimator.decay = std::exp(-5.0 * 0.005);
  c.estimator.held_integral_s = (1.0 - c.estimator.decay) / 5.0;
  c.estimator.D_inverse = c.model.D.topRows<2>().inverse();

  const std::size_t np = valve_state ? 6 : 5;
  const std::size_t i_u_ss = np - 3;
  joint.gain.assign(np, 0.0);
  joint.gain[0] = -40.0;
  joint.gain[1] = -2.0;
  joint.gain[i_u_ss] = 1.0;
  c.law.u_min = -100.0 / 9.0;  // (5 V − 0 V)/0.45 V
  c.law.u_max = 100.0 / 9.0;
  c.law.lower.fill(-22.0);
  c.law.upper.fill(22.0);

  c.valve = {5.0, 0.45, 0.0, 10.0, 0.0, 4000.0};
  c.safety.reference_angle_max_rad = 1.0;
  set_reference_frames(c);
  return joint;
}

// Call when gain and offset are final.
inline void connect(ReferenceJoint& joint) {
  joint.packing = service::LawPacking(service::one_piece_law(joint.gain, joint.offset));
  joint.config.law.packed = joint.packing.law();
}

}  // namespace eampc::control
