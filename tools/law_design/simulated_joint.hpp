// The rig without hardware: valves (2) with a lag, muscles (3), (4), joint (5), encoder. In: valve
// frame (V) → out: encoder frame (rad, rad/s). Nonlinear as written, not the design's linear model.
// Absent: friction, hysteresis, supply limits and the valve node's own time-out: the emulator has
// those.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "control/controller_config.hpp"

namespace eampc::law_design {

enum class DisturbanceKind { kConstant, kStep, kSine, kSineOfStateSum, kCosineOfStateSum, kPulse };

// One term of d(t, x) in rad/s²; t is the scenario's time.
struct DisturbanceTerm {
  DisturbanceKind kind = DisturbanceKind::kConstant;
  double amplitude_rad_s2 = 0.0;
  double frequency_hz = 0.0;  // sine
  double start_s = 0.0;       // step, pulse
  double end_s = 0.0;         // pulse, excluded
};

struct PlantParameters {
  double moment_of_inertia_kg_m2 = 0.0;
  double viscous_damping_N_m_s_rad = 0.0;
  double gear_radius_m = 0.0;
  double k1_N_per_MPa = 0.0;
  double k2_N_per_MPa = 0.0;
  double k3_N_per_MPa = 0.0;
  double k4_N = 0.0;
  double initial_contraction_ratio = 0.0;
  double initial_length_m = 0.0;
  double pressure_gain_MPa_per_V = 0.0;
  double min_V = 0.0;
  double max_V = 0.0;
  double safe_V = 0.0;
  double valve_time_constant_s = 0.0;  // 0: ideal
  double initial_angle_rad = 0.0;
  double initial_velocity_rad_s = 0.0;
  bool hold_until_start = false;  // the joint keeps its start while the scenario's time is negative
  int substeps = 10;              // of RK4 per period
  double encoder_noise_rad = 0.0;  // standard deviations
  double velocity_noise_rad_s = 0.0;
  std::uint64_t seed = 1;
  std::vector<DisturbanceTerm> disturbance;
};

struct PlantState {
  double angle_rad = 0.0;
  double velocity_rad_s = 0.0;
  double pressure1_MPa = 0.0;
  double pressure2_MPa = 0.0;
};

class SimulatedJoint {
 public:
  // Starts with both valves at rest at safe_V.
  SimulatedJoint(const PlantParameters& parameters, double period_s);

  // What the encoder sends now; each call is one frame.
  control::Frame encoder_frame(const control::EncoderLayout& layout);

  // One period with this command from `time_s` (scenario time) on. A frame that is wrong or not
  // enabled: safe_V.
  void advance(const control::ValveCommandLayout& layout, const control::Frame& command,
               double time_s);

  const PlantState& state() const { return state_; }
  double torque_N_m() const;
  double disturbance_rad_s2(double time_s) const;

 private:
  double disturbance_at(double smooth_time_s, double jump_time_s, double angle_rad,
                        double velocity_rad_s) const;
  double torque_at(double angle_rad, double pressure1_MPa, double pressure2_MPa) const;
  double acceleration(double smooth_time_s, double jump_time_s, double angle_rad,
                      double velocity_rad_s, double pressure1_MPa, double pressure2_MPa) const;
  void substep(double time_s, double h_s, double target1_MPa, double target2_MPa, bool held);

  PlantParameters plant_;
  double period_s_;
  PlantState state_;
  std::uint64_t counter_ = 0;
  std::mt19937_64 random_;
};

}  // namespace eampc::law_design
