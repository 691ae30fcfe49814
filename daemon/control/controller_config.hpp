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

// The monitored messages; `present` false: the rig does not monitor it, and has no such fault.
struct MonitoredLayout {
  bool present = false;
  std::uint32_t id = 0;
  bool extended = false;
  int length = 8;
  CrcLayout crc;
};

struct ValveFeedbackLayout : MonitoredLayout {
  SignalLayout pressure1, pressure2, supply_pressure;
};

struct HeartbeatLayout : MonitoredLayout {
  SignalLayout state;  // CANopen's node state; 0: the node has just started
};

struct EmergencyLayout : MonitoredLayout {
  SignalLayout error_code;  // 0: no error any more; without the signal every frame is an error
};

struct EStopLayout : MonitoredLayout {
  SignalLayout stop;
  std::uint64_t released_raw = 0;  // any other value stops
};

struct IdentityLayout : MonitoredLayout {
  SignalLayout inputs_crc32;
};

// CANopen's command that starts the nodes. Present: a node whose heartbeat says another state than
// `operational_raw` obeys no command, and counts as lost.
struct NodeStart {
  bool present = false;
  Frame frame;
  std::uint64_t operational_raw = 5;
};

// Thresholds and actions of the fault matrix. Names are the keys of section [safety]; times are
// rounded to periods. 0 switches those off that say so.
struct SafetyConfig {
  double encoder_timeout_s = 0.02;
  double arming_ramp_s = 0.5;  // 0: straight to the law
  double soft_stop_ramp_s = 0.5;
  // After the pressure ramp the law acts so long within reduced limits before ACTIVE; 0: not at
  // all.
  double reduced_limits_s = 0.0;
  double reduced_control_share = 0.5;  // of law.u_min..u_max
  double reduced_slew_V_per_s = std::numeric_limits<double>::infinity();

  std::int32_t encoder_invalid_frames = 3;  // in a row without a valid one
  // Position and velocity bit for bit the same for so long while the command is further than
  // encoder_frozen_command_V from where it stood when they last changed; 0: off.
  double encoder_frozen_s = 0.0;
  double encoder_frozen_command_V = 0.5;  // of (u1 − u2)/2
  // |Δθ| above velocity · elapsed + margin is a jump.
  double encoder_jump_velocity_rad_s = std::numeric_limits<double>::infinity();
  double encoder_jump_margin_rad = 0.05;
  std::int32_t encoder_counter_gap_max = std::numeric_limits<std::int32_t>::max();  // lost frames
  std::uint32_t encoder_status_mask = 0;  // raw bits that mean a failure

  double error_passive_s = 0.1;
  std::int32_t tx_unconfirmed_periods = 2;
  std::int32_t send_refused_frames = 2;
  double heartbeat_timeout_s = 0.35;
  double e_stop_timeout_s = 0.0;  // 0: its message only comes when the button moves
  double supply_pressure_min_kPa = -std::numeric_limits<double>::infinity();
  double supply_pressure_max_kPa = std::numeric_limits<double>::infinity();
  double supply_pressure_s = 0.1;  // so long out of range, or unknown
  std::int32_t deadline_overruns_max = std::numeric_limits<std::int32_t>::max();  // per window
  double deadline_overruns_window_s = 1.0;

  FaultActions actions = default_fault_actions();
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
  ValveFeedbackLayout valve_feedback;
  HeartbeatLayout heartbeat;
  EmergencyLayout emergency;
  EStopLayout e_stop;
  IdentityLayout identity;
  NodeStart node_start;
  std::uint32_t inputs_crc32 = 0;  // of the rig the law was designed for
  bool trigger_on_sync = false;
};

}  // namespace eampc::control
