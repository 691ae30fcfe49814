// Everything the control cycle reads: filled from the law file before real time starts, never
// written after. Matrices have the size of the largest model; the unused last row and column are
// zero for ideal valves.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>

#include "control/control_types.hpp"
#include "control/point_location.hpp"

namespace eampc::control {

// Where one DBC signal lies in its frame. Physical value = raw·factor + offset.
struct SignalLayout {
  bool present = false;
  int start_bit =
      0;  // as the DBC counts: least significant bit (Intel) or most significant bit (Motorola)
  int length = 0;  // 1..64
  bool little_endian = true;
  bool is_signed = false;
  double factor = 1.0;
  double offset = 0.0;
  // Physical range of the DBC; a measured signal outside it is not believed.
  double minimum = -std::numeric_limits<double>::infinity();
  double maximum = std::numeric_limits<double>::infinity();
};

// SAE J1850 CRC-8 over the data id's low and high byte, then the frame's bytes but the CRC's own.
struct CrcLayout {
  bool present = false;
  int byte = 0;
  std::uint16_t data_id = 0;
};

struct EncoderLayout {
  std::uint32_t id = 0;
  bool extended = false;
  int length = 8;
  SignalLayout angle, velocity, counter, status;
  CrcLayout crc;
};

struct ValveCommandLayout {
  std::uint32_t id = 0;
  bool extended = false;
  int length = 8;
  SignalLayout u1, u2, enable, counter;
  CrcLayout crc;
};

struct SyncLayout {
  bool present = false;
  std::uint32_t id = 0;
  bool extended = false;
  int length = 1;
  SignalLayout counter;  // the first signal of the message, if any
};

using StateVector = Eigen::Matrix<double, kMaxStates, 1>;
using StateMatrix = Eigen::Matrix<double, kMaxStates, kMaxStates>;
using MeasuredVector = Eigen::Matrix<double, kMaxMeasured, 1>;
using MeasuredMatrix = Eigen::Matrix<double, kMaxMeasured, kMaxMeasured>;

// x⁺ = A* x + B* u + D δ, δ on (ẋ1, ẋ2) (design 2.1 item 4).
struct DiscreteModel {
  int order = 2;
  double period_s = 0.005;
  StateMatrix A = StateMatrix::Zero();  // continuous, for the predictor as printed
  StateVector B = StateVector::Zero();
  StateMatrix A_star = StateMatrix::Zero();
  StateVector B_star = StateVector::Zero();
  Eigen::Matrix<double, kMaxStates, kMaxMeasured> D =
      Eigen::Matrix<double, kMaxStates, kMaxMeasured>::Zero();
  double b = 0.0;                      // rad/s² per unit of u
  double b1 = 0.0;                     // 1/s²
  double b2 = 0.0;                     // 1/s
  double valve_time_constant_s = 0.0;  // 0: ideal
};

enum class EstimatorKind : std::uint8_t { kAdaptive, kKalman };

struct EstimatorConfig {
  EstimatorKind kind = EstimatorKind::kAdaptive;
  double decay = 1.0;                                 // e^{−aT} of (13), (14)
  MeasuredMatrix D_inverse = MeasuredMatrix::Zero();  // inverse of D on the measured coordinates
  bool bias_compensation = true;
  // d̂ ← d̂ + α (new − d̂); 1 switches the low-pass off.
  double low_pass_alpha = 1.0;
  // Predictor of (13) integrated with x held over the period, as printed (for `reproduce`).
  bool as_printed = false;
  double held_integral_s =
      0.0;  // (1 − e^{−aT})/a, so Φ(T) of (14) = decay/held_integral_s; as_printed only
  // Steady-state Kalman gains on (θ, θ̇) and d per rad of innovation; v is propagated.
  std::array<double, 2> kalman_state_gain{};
  double kalman_disturbance_gain = 0.0;
};

enum class Formulation : std::uint8_t { kPaper, kTracking };

struct LawConfig {
  Formulation formulation = Formulation::kTracking;
  bool reference_is_parameter = false;  // `paper` with y_r as fifth parameter
  double fixed_reference_rad = 0.0;     // `paper`
  double u_min = 0.0;                   // clip of the law's value, units of u
  double u_max = 0.0;
  std::array<double, kMaxParameters> lower{};
  std::array<double, kMaxParameters> upper{};
  PackedLaw packed;  // spans into storage owned by whoever loaded the law file
};

struct ValveConfig {
  double bias_V = 0.0;          // u0
  double control_gain_V = 0.0;  // ku
  double min_V = 0.0;
  double max_V = 0.0;
  double safe_V = 0.0;
  double slew_max_V_per_s = 0.0;
};

struct SafetyConfig {
  double encoder_timeout_s = 0.02;
  double arming_ramp_s = 0.5;  // 0: straight to the law
  double soft_stop_ramp_s = 0.5;
  StopAction encoder_timeout_action = StopAction::kSoftStop;
  StopAction encoder_invalid_action = StopAction::kSoftStop;
  double reference_angle_max_rad = 0.0;  // references are clamped to ± this
};

struct ControllerConfig {
  DiscreteModel model;
  EstimatorConfig estimator;
  LawConfig law;
  ValveConfig valve;
  SafetyConfig safety;
  EncoderLayout encoder;
  ValveCommandLayout valve_command;
  SyncLayout sync;
  bool trigger_on_sync = false;
};

}  // namespace eampc::control
