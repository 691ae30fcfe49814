// Valve lag (2), muscles (3), (4) and joint (5) over one period of held commands. In: the valves'
// targets (MPa), d at the ends of the period → out: angle, velocity, pressures.
//
// The two muscles are alike, so with s = r θ/L0 the torque is
//   r ((P1 − P2)(k1 s² + c0) + (P1 + P2) c1 s),  c0 = k1 ε0² + k2 ε0 + k3,  c1 = 2 k1 ε0 + k2,
// k4 cancels, and pressure difference and sum relax towards their targets in closed form. The rest,
//   θ̈ = Δ(g0 + g2 θ²) + Σ g1 θ − β θ̇ + d,
// is one classic Runge–Kutta step per substep. d is linear in time plus a sine, which turns by a
// complex product: no trigonometric function, no allocation, some 30 operations per stage.
// Absent: friction, hysteresis and end stops (the emulator has those).
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "law_design/simulated_joint.hpp"

namespace eampc::law_design {

// d at one instant: a level and a sine as (cos, sin) of its phase.
struct SmoothDisturbance {
  double amplitude_rad_s2 = 0.0;
  double cosine = 1.0;
  double sine = 0.0;
};

class JointIntegrator {
 public:
  // Rest at safe_V. `frequency_hz` is the disturbance's.
  JointIntegrator(const PlantParameters& plant, double period_s, double frequency_hz) {
    const double r = plant.gear_radius_m;
    const double per_rad = r / plant.initial_length_m;
    const double per_inertia = r / plant.moment_of_inertia_kg_m2;
    const double e0 = plant.initial_contraction_ratio;
    gain_ =
        per_inertia * ((plant.k1_N_per_MPa * e0 + plant.k2_N_per_MPa) * e0 + plant.k3_N_per_MPa);
    curvature_ = per_inertia * plant.k1_N_per_MPa * per_rad * per_rad;
    stiffness_ = per_inertia * (2.0 * plant.k1_N_per_MPa * e0 + plant.k2_N_per_MPa) * per_rad;
    damping_ = plant.viscous_damping_N_m_s_rad / plant.moment_of_inertia_kg_m2;
    const double pressure_MPa =
        plant.pressure_gain_MPa_per_V * std::clamp(plant.safe_V, plant.min_V, plant.max_V);
    angle_rad = plant.initial_angle_rad;
    velocity_rad_s = plant.initial_velocity_rad_s;
    sum_MPa = 2.0 * pressure_MPa;

    const double highest_MPa =
        2.0 * plant.pressure_gain_MPa_per_V * std::max(std::abs(plant.min_V), plant.max_V);
    const bool lagging = plant.valve_time_constant_s > 0.0;
    const double fastest_per_s = std::max({std::sqrt(std::abs(stiffness_) * highest_MPa), damping_,
                                           lagging ? 1.0 / plant.valve_time_constant_s : 0.0,
                                           2.0 * std::numbers::pi * frequency_hz});
    substeps_ = std::max(2, static_cast<int>(std::ceil(period_s * fastest_per_s / kStepTimesRate)));
    h_s_ = period_s / substeps_;
    half_decay_ = lagging ? std::exp(-0.5 * h_s_ / plant.valve_time_constant_s) : 0.0;
    const double turn_rad = std::numbers::pi * frequency_hz * h_s_;
    turn_cosine_ = std::cos(turn_rad);
    turn_sine_ = std::sin(turn_rad);
  }

  // One period. `level` goes linearly from `level0` to `level1`; with `turning` the sine turns.
  // Returns the largest |θ| and |θ̇| met at the substeps' ends.
  struct Extremes {
    double angle_rad = 0.0;
    double velocity_rad_s = 0.0;
  };
  Extremes advance(double target1_MPa, double target2_MPa, double level0_rad_s2,
                   double level1_rad_s2, SmoothDisturbance& d, bool turning) {
    const double difference_target = target1_MPa - target2_MPa;
    const double sum_target = target1_MPa + target2_MPa;
    if (half_decay_ == 0.0) {
      difference_MPa = difference_target;
      sum_MPa = sum_target;
    }
    const double slope = 0.5 * (level1_rad_s2 - level0_rad_s2) / substeps_;
    double level = level0_rad_s2;
    Extremes most;
    for (int i = 0; i < substeps_; ++i) {
      const double difference_mid =
          difference_target + (difference_MPa - difference_target) * half_decay_;
      const double sum_mid = sum_target + (sum_MPa - sum_target) * half_decay_;
      const double difference_end =
          difference_target + (difference_mid - difference_target) * half_decay_;
      const double sum_end = sum_target + (sum_mid - sum_target) * half_decay_;
      const double d0 = level + d.amplitude_rad_s2 * d.sine;
      if (turning) turn(d);
      const double d1 = level + slope + d.amplitude_rad_s2 * d.sine;
      if (turning) turn(d);
      level += 2.0 * slope;
      const double d2 = level + d.amplitude_rad_s2 * d.sine;

      const double q = angle_rad;
      const double w = velocity_rad_s;
      const double half = 0.5 * h_s_;
      const double a1 = acceleration(q, w, difference_MPa, sum_MPa, d0);
      const double w2 = w + half * a1;
      const double a2 = acceleration(q + half * w, w2, difference_mid, sum_mid, d1);
      const double w3 = w + half * a2;
      const double a3 = acceleration(q + half * w2, w3, difference_mid, sum_mid, d1);
      const double w4 = w + h_s_ * a3;
      const double a4 = acceleration(q + h_s_ * w3, w4, difference_end, sum_end, d2);
      angle_rad = q + h_s_ / 6.0 * (w + 2.0 * (w2 + w3) + w4);
      velocity_rad_s = w + h_s_ / 6.0 * (a1 + 2.0 * (a2 + a3) + a4);
      difference_MPa = difference_end;
      sum_MPa = sum_end;
      most.angle_rad = std::max(most.angle_rad, std::abs(angle_rad));
      most.velocity_rad_s = std::max(most.velocity_rad_s, std::abs(velocity_rad_s));
    }
    return most;
  }

  // The joint held, the valves at work.
  void advance_held(double target1_MPa, double target2_MPa) {
    double decay = 1.0;
    for (int i = 0; i < 2 * substeps_; ++i) decay *= half_decay_;
    difference_MPa =
        target1_MPa - target2_MPa + (difference_MPa - (target1_MPa - target2_MPa)) * decay;
    sum_MPa = target1_MPa + target2_MPa + (sum_MPa - (target1_MPa + target2_MPa)) * decay;
  }

  PlantState state() const {
    return {angle_rad, velocity_rad_s, 0.5 * (sum_MPa + difference_MPa),
            0.5 * (sum_MPa - difference_MPa)};
  }

  // θ̈ by the muscles alone.
  double muscle_acceleration_rad_s2() const {
    return acceleration(angle_rad, 0.0, difference_MPa, sum_MPa, 0.0);
  }

  double angle_rad = 0.0;
  double velocity_rad_s = 0.0;
  double difference_MPa = 0.0;  // P1 − P2
  double sum_MPa = 0.0;         // P1 + P2

 private:
  // Longest substep times the plant's fastest rate: local errors of order 0.2⁵/120 of the motion.
  // A test holds the sum of them to 1e-6 rad over a second against a hundred times finer steps.
  static constexpr double kStepTimesRate = 0.2;

  double acceleration(double q, double w, double difference, double sum, double d) const {
    return difference * (gain_ + curvature_ * (q * q)) + sum * (stiffness_ * q) - damping_ * w + d;
  }

  void turn(SmoothDisturbance& d) const {
    const double cosine = d.cosine * turn_cosine_ - d.sine * turn_sine_;
    d.sine = d.sine * turn_cosine_ + d.cosine * turn_sine_;
    d.cosine = cosine;
  }

  double gain_, curvature_, stiffness_, damping_;
  int substeps_;
  double h_s_;
  double half_decay_;  // of the lag, over half a substep; 0: ideal valves
  double turn_cosine_, turn_sine_;
};

}  // namespace eampc::law_design
