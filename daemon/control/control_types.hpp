// The nouns that pass between the stages of the control cycle: encoder frame → sample → state →
// disturbance → law → safety → valve frame. Units are in the field names; inside an equation the
// paper's symbols are used (x, u, v, σ̂). No behaviour stands here.
#pragma once

#include <array>
#include <cstdint>

#include "control/fault.hpp"

namespace eampc::control {

// (θ, θ̇, v): the model with valve states has three, the ideal-valve model uses the first two.
inline constexpr int kMaxStates = 3;
// Measured coordinates: θ and, if the encoder sends it, θ̇.
inline constexpr int kMaxMeasured = 2;

// One classic CAN frame. Error frames and FD frames never get this far.
struct Frame {
  std::uint32_t id = 0;  // 11 or 29 bits, without flag bits
  bool extended = false;
  bool remote = false;
  std::uint8_t length = 0;  // 0..8
  std::array<std::uint8_t, 8> data{};
};

enum class SampleVerdict : std::uint8_t {
  kValid,
  kMissing,
  kWrongLength,
  kBadCrc,
  kDuplicate,
  kOutOfRange,
  kJump  // further from the value before than the joint can move
};

// What the encoder said in this cycle. `angle_rad` and `velocity_rad_s` mean something only if
// valid.
struct EncoderSample {
  SampleVerdict verdict = SampleVerdict::kMissing;
  double angle_rad = 0.0;
  double velocity_rad_s = 0.0;
  bool has_velocity = false;
  std::uint32_t status_raw = 0;
  std::uint32_t missed_frames = 0;  // counter gap before this frame
};

struct StateEstimate {
  std::array<double, kMaxStates> x{};  // θ rad, θ̇ rad/s, v (units of u)
  double innovation_rad = 0.0;         // measured minus predicted angle; 0 without a measurement
  double innovation_rad_s = 0.0;       // the same for the velocity; 0 if the encoder sends none
  bool measured = false;               // this period had a valid sample
  bool restarted = false;  // first sample ever, or after a silence longer than the time-out
  std::int32_t predicted_periods =
      1;  // periods between the innovation's prediction and the sample before it
};

// σ̂ of (14) on (ẋ1, ẋ2); [1] is d̂ in rad/s². `for_law` is what the law reads: bias compensated,
// filtered.
struct DisturbanceEstimate {
  std::array<double, kMaxMeasured> sigma{};
  std::array<double, kMaxMeasured> for_law{};
};

struct Reference {
  double angle_rad = 0.0;
  double velocity_rad_s = 0.0;
  double acceleration_rad_s2 = 0.0;
};

struct LawOutput {
  double u = 0.0;            // dimensionless control of (1), clipped to the law's range if finite
  std::int32_t region = -1;  // index of the affine piece; -1: the law did not run
  bool parameter_clamped = false;
  bool at_range_end = false;  // u stands at law.u_min or law.u_max
};

struct ValveVoltages {
  double u1_V = 0.0;
  double u2_V = 0.0;
  bool enable = false;
};

// Where a voltage may lie after rounding to the frame's resolution: box and slew limit in one.
struct VoltageWindow {
  double lower_V = 0.0;
  double upper_V = 0.0;
};

// What safety hands to the valve codec. The voltage sent before lies inside its window, so a
// representable one exists.
struct ValveDemand {
  ValveVoltages voltages;
  VoltageWindow u1;
  VoltageWindow u2;
};

enum class Mode : std::uint8_t { kInit, kDisarmed, kArming, kActive, kSoftStop, kFault };

// Limits inform. Bits, so that several may act at once.
enum Limit : std::uint32_t {
  kLimitNone = 0,
  kLimitControlRange = 1u << 0,    // valve.min_V, valve.max_V
  kLimitSlewRate = 1u << 1,        // valve.slew_max_V_per_s
  kLimitParameterBox = 1u << 2,    // parameter_box.*
  kLimitReferenceRange = 1u << 3,  // constraints.angle_max_rad: the reference was clamped
  kLimitReduced = 1u << 4,         // safety.reduced_limits_s: the law acts within reduced limits
};

const char* mode_text(Mode mode) noexcept;
const char* limit_text(Limit limit) noexcept;  // one bit: "slew rate (valve.slew_max_V_per_s)"
const char* verdict_text(SampleVerdict verdict) noexcept;

enum class OperatorAction : std::uint8_t { kNone, kArm, kDisarm, kReset };

}  // namespace eampc::control
