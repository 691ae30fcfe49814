// The published texts of the enumerations. A limit names the configuration key that sets it.
#include "control/control_types.hpp"

namespace eampc::control {

const char* mode_text(Mode mode) noexcept {
  switch (mode) {
    case Mode::kInit:
      return "INIT";
    case Mode::kDisarmed:
      return "DISARMED";
    case Mode::kArming:
      return "ARMING";
    case Mode::kActive:
      return "ACTIVE";
    case Mode::kSoftStop:
      return "SOFT_STOP";
    case Mode::kFault:
      return "FAULT";
  }
  return "unknown";
}

const char* limit_text(Limit limit) noexcept {
  switch (limit) {
    case kLimitNone:
      return "none";
    case kLimitControlRange:
      return "control range (valve.min_V, valve.max_V)";
    case kLimitSlewRate:
      return "slew rate (valve.slew_max_V_per_s)";
    case kLimitParameterBox:
      return "parameter box (parameter_box)";
    case kLimitReferenceRange:
      return "reference range (constraints.angle_max_rad)";
    case kLimitReduced:
      return "reduced limits after arming (safety.reduced_limits_s)";
  }
  return "unknown";
}

const char* verdict_text(SampleVerdict verdict) noexcept {
  switch (verdict) {
    case SampleVerdict::kValid:
      return "valid";
    case SampleVerdict::kMissing:
      return "missing";
    case SampleVerdict::kWrongLength:
      return "wrong length";
    case SampleVerdict::kBadCrc:
      return "bad CRC";
    case SampleVerdict::kDuplicate:
      return "duplicate";
    case SampleVerdict::kOutOfRange:
      return "out of range";
    case SampleVerdict::kJump:
      return "implausible jump";
  }
  return "unknown";
}

}  // namespace eampc::control
