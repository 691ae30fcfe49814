// A controller of one affine piece on the reference rig's frames, for tests of the loop around it.
#pragma once

#include <array>
#include <cstdint>

#include "control/controller_config.hpp"
#include "control/encoder_codec.hpp"
#include "one_piece_law.hpp"
#include "service/law_packing.hpp"

namespace eampc::testing {

inline constexpr std::uint32_t kEncoderId = 0x181;
inline constexpr std::uint32_t kCommandId = 0x201;
inline constexpr std::uint32_t kSyncId = 0x80;

inline control::SignalLayout intel(int start_bit, int length, bool is_signed, double factor) {
  control::SignalLayout layout;
  layout.present = true;
  layout.start_bit = start_bit;
  layout.length = length;
  layout.is_signed = is_signed;
  layout.factor = factor;
  return layout;
}

inline control::ControllerConfig toy_config(double period_s) {
  control::ControllerConfig config;
  config.model.period_s = period_s;
  config.model.A_star.topLeftCorner<2, 2>() << 1.0, period_s, 0.0, 1.0;
  config.model.B_star(1) = period_s;
  config.model.D.topRows<2>() = period_s * control::MeasuredMatrix::Identity();
  config.model.b = 1.0;
  config.estimator.D_inverse = control::MeasuredMatrix::Identity() / period_s;
  config.estimator.decay = 0.975;

  static const service::LawPacking kPacking(
      service::one_piece_law({-1.0, 0.0, 0.0, 0.0, 0.0}, 0.0));
  config.law.packed = kPacking.law();
  config.law.lower.fill(-10.0);
  config.law.upper.fill(10.0);
  config.law.u_min = -5.0;
  config.law.u_max = 5.0;

  config.valve.bias_V = 5.0;
  config.valve.control_gain_V = 1.0;
  config.valve.max_V = 10.0;
  config.valve.slew_max_V_per_s = 1e6;
  config.safety.encoder_timeout_s = 20 * period_s;
  config.safety.arming_ramp_s = 0.0;
  config.safety.soft_stop_ramp_s = 4 * period_s;
  config.safety.reference_angle_max_rad = 1.0;

  config.encoder.id = kEncoderId;
  config.encoder.angle = intel(0, 24, true, 1e-4);
  config.encoder.velocity = intel(24, 16, true, 1e-3);
  config.encoder.counter = intel(40, 4, false, 1.0);
  config.valve_command.id = kCommandId;
  config.valve_command.u1 = intel(0, 16, true, 1e-3);
  config.valve_command.u2 = intel(16, 16, true, 1e-3);
  config.valve_command.enable = intel(32, 1, false, 1.0);
  config.valve_command.counter = intel(36, 4, false, 1.0);
  config.sync.present = true;
  config.sync.id = kSyncId;
  config.sync.counter = intel(0, 8, false, 1.0);
  return config;
}

}  // namespace eampc::testing
