#include "law_design/simulated_joint.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "control/encoder_codec.hpp"
#include "control/valve_codec.hpp"

namespace eampc::law_design {

SimulatedJoint::SimulatedJoint(const PlantParameters& parameters, double period_s)
    : plant_(parameters), period_s_(period_s), random_(parameters.seed) {
  const double start_V = std::clamp(plant_.safe_V, plant_.min_V, plant_.max_V);
  const double pressure_MPa = plant_.pressure_gain_MPa_per_V * start_V;
  state_ = {plant_.initial_angle_rad, plant_.initial_velocity_rad_s, pressure_MPa, pressure_MPa};
}

control::Frame SimulatedJoint::encoder_frame(const control::EncoderLayout& layout) {
  double angle_rad = state_.angle_rad;
  double velocity_rad_s = state_.velocity_rad_s;
  if (plant_.encoder_noise_rad > 0.0) {
    angle_rad += std::normal_distribution<double>(0.0, plant_.encoder_noise_rad)(random_);
  }
  if (plant_.velocity_noise_rad_s > 0.0) {
    velocity_rad_s += std::normal_distribution<double>(0.0, plant_.velocity_noise_rad_s)(random_);
  }
  return control::encode_encoder_frame(layout, angle_rad, velocity_rad_s, counter_++, 0);
}

double SimulatedJoint::disturbance_at(double smooth_time_s, double jump_time_s, double angle_rad,
                                      double velocity_rad_s) const {
  double sum_rad_s2 = 0.0;
  for (const DisturbanceTerm& term : plant_.disturbance) {
    const double A = term.amplitude_rad_s2;
    switch (term.kind) {
      case DisturbanceKind::kConstant:
        sum_rad_s2 += A;
        break;
      case DisturbanceKind::kStep:
        sum_rad_s2 += jump_time_s >= term.start_s ? A : 0.0;
        break;
      case DisturbanceKind::kSine:
        sum_rad_s2 += A * std::sin(2.0 * std::numbers::pi * term.frequency_hz * smooth_time_s);
        break;
      case DisturbanceKind::kSineOfStateSum:
        sum_rad_s2 += A * std::sin(angle_rad + velocity_rad_s);
        break;
      case DisturbanceKind::kCosineOfStateSum:
        sum_rad_s2 += A * std::cos(angle_rad + velocity_rad_s);
        break;
      case DisturbanceKind::kPulse:
        sum_rad_s2 += jump_time_s >= term.start_s && jump_time_s < term.end_s ? A : 0.0;
        break;
    }
  }
  return sum_rad_s2;
}

double SimulatedJoint::disturbance_rad_s2(double time_s) const {
  // The first half substep decides which side of a jump the instant belongs to.
  const double jump_time_s = time_s + 0.5 * period_s_ / plant_.substeps;
  return disturbance_at(time_s, jump_time_s, state_.angle_rad, state_.velocity_rad_s);
}

double SimulatedJoint::torque_at(double angle_rad, double pressure1_MPa,
                                 double pressure2_MPa) const {
  const double shift = plant_.gear_radius_m * angle_rad / plant_.initial_length_m;
  const auto force_N = [&](double pressure_MPa, double epsilon) {
    return pressure_MPa * ((plant_.k1_N_per_MPa * epsilon + plant_.k2_N_per_MPa) * epsilon +
                           plant_.k3_N_per_MPa) +
           plant_.k4_N;
  };
  return plant_.gear_radius_m * (force_N(pressure1_MPa, plant_.initial_contraction_ratio + shift) -
                                 force_N(pressure2_MPa, plant_.initial_contraction_ratio - shift));
}

double SimulatedJoint::torque_N_m() const {
  return torque_at(state_.angle_rad, state_.pressure1_MPa, state_.pressure2_MPa);
}

double SimulatedJoint::acceleration(double smooth_time_s, double jump_time_s, double angle_rad,
                                    double velocity_rad_s, double pressure1_MPa,
                                    double pressure2_MPa) const {
  return (torque_at(angle_rad, pressure1_MPa, pressure2_MPa) -
          plant_.viscous_damping_N_m_s_rad * velocity_rad_s) /
             plant_.moment_of_inertia_kg_m2 +
         disturbance_at(smooth_time_s, jump_time_s, angle_rad, velocity_rad_s);
}

void SimulatedJoint::substep(double time_s, double h_s, double target1_MPa, double target2_MPa,
                             bool held) {
  // The command is held, so the lag of the valves has a closed form at every stage of RK4.
  const auto pressure_after = [&](double pressure_MPa, double target_MPa, double duration_s) {
    if (plant_.valve_time_constant_s <= 0.0) {
      return target_MPa;
    }
    return target_MPa +
           (pressure_MPa - target_MPa) * std::exp(-duration_s / plant_.valve_time_constant_s);
  };
  const double half1 = pressure_after(state_.pressure1_MPa, target1_MPa, 0.5 * h_s);
  const double half2 = pressure_after(state_.pressure2_MPa, target2_MPa, 0.5 * h_s);
  const double end1 = pressure_after(state_.pressure1_MPa, target1_MPa, h_s);
  const double end2 = pressure_after(state_.pressure2_MPa, target2_MPa, h_s);
  if (!held) {
    const bool ideal = plant_.valve_time_constant_s <= 0.0;
    const double start1 = ideal ? target1_MPa : state_.pressure1_MPa;
    const double start2 = ideal ? target2_MPa : state_.pressure2_MPa;
    const double q = state_.angle_rad;
    const double w = state_.velocity_rad_s;
    // A jump of d falls on a substep's edge if it lies on the grid of the periods: its middle
    // decides.
    const double jump_s = time_s + 0.5 * h_s;
    const double a1 = acceleration(time_s, jump_s, q, w, start1, start2);
    const double w2 = w + 0.5 * h_s * a1;
    const double a2 = acceleration(jump_s, jump_s, q + 0.5 * h_s * w, w2, half1, half2);
    const double w3 = w + 0.5 * h_s * a2;
    const double a3 = acceleration(jump_s, jump_s, q + 0.5 * h_s * w2, w3, half1, half2);
    const double w4 = w + h_s * a3;
    const double a4 = acceleration(time_s + h_s, jump_s, q + h_s * w3, w4, end1, end2);
    state_.angle_rad = q + h_s / 6.0 * (w + 2.0 * w2 + 2.0 * w3 + w4);
    state_.velocity_rad_s = w + h_s / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
  }
  state_.pressure1_MPa = end1;
  state_.pressure2_MPa = end2;
}

void SimulatedJoint::advance(const control::ValveCommandLayout& layout,
                             const control::Frame& command, double time_s) {
  control::ValveVoltages voltages;
  if (!control::decode_valve_frame(layout, command, voltages) || !voltages.enable) {
    voltages = {plant_.safe_V, plant_.safe_V, false};
  }
  const auto target_MPa = [&](double voltage_V) {
    return plant_.pressure_gain_MPa_per_V * std::clamp(voltage_V, plant_.min_V, plant_.max_V);
  };
  // Half a substep of grace: −0.0 − ε at the lead's last period is still before the start, 0 is
  // not.
  const double h_s = period_s_ / plant_.substeps;
  const bool held = plant_.hold_until_start && time_s < -0.5 * h_s;
  for (int i = 0; i < plant_.substeps; ++i) {
    substep(time_s + h_s * i, h_s, target_MPa(voltages.u1_V), target_MPa(voltages.u2_V), held);
  }
}

}  // namespace eampc::law_design
