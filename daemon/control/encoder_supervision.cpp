#include "control/encoder_supervision.hpp"

#include <algorithm>
#include <cmath>

#include "control/period_count.hpp"

namespace eampc::control {

EncoderSupervision::EncoderSupervision(const ControllerConfig& config) noexcept
    : config_(config),
      timeout_periods_(
          std::max(1, periods_in(config.safety.encoder_timeout_s, config.model.period_s))),
      frozen_limit_periods_(
          config.safety.encoder_frozen_s > 0.0
              ? std::max(1, periods_in(config.safety.encoder_frozen_s, config.model.period_s))
              : 0) {}

FaultSet EncoderSupervision::check(EncoderSample& sample, std::int32_t elapsed_periods,
                                   const ValveVoltages& sent, bool law_acts) noexcept {
  const SafetyConfig& safety = config_.safety;
  const double command_V = 0.5 * (sent.u1_V - sent.u2_V);
  if (!law_acts) {  // a joint that is let down or at rest may stand still
    frozen_periods_ = 0;
    command_at_change_V_ = command_V;
  }
  FaultSet present;
  if (sample.verdict == SampleVerdict::kValid) {
    // Frames that only the counter misses were a silence like any other.
    present.add(Fault::kEncoderTimeout,
                seen_ && periods_without_sample_ + elapsed_periods - 1 >= timeout_periods_);
    // Frames that came but could not be believed are not lost.
    const std::int64_t lost = std::int64_t{sample.missed_frames} - invalid_run_;
    present.add(Fault::kEncoderCounterGap, lost > safety.encoder_counter_gap_max);
    periods_without_sample_ = std::min(periods_without_sample_ + elapsed_periods, timeout_periods_);
    check_frozen(sample, elapsed_periods, command_V);
    check_jump(sample, present);
    periods_without_sample_ = 0;
    invalid_run_ = 0;
    verdict_since_sample_ = SampleVerdict::kMissing;
    status_failure_ = (sample.status_raw & safety.encoder_status_mask) != 0;
  } else {
    periods_without_sample_ = std::min(periods_without_sample_ + elapsed_periods, timeout_periods_);
    if (sample.verdict != SampleVerdict::kMissing) {
      verdict_since_sample_ = sample.verdict;
      if (sample.verdict != SampleVerdict::kDuplicate) {
        invalid_run_ = std::min(invalid_run_ + 1, safety.encoder_invalid_frames);
      }
    }
    if (periods_without_sample_ >= timeout_periods_ ||
        invalid_run_ >= safety.encoder_invalid_frames) {
      present.add(cause_of_silence());
    }
  }
  present.add(Fault::kEncoderFrozen,
              frozen_limit_periods_ > 0 && frozen_periods_ >= frozen_limit_periods_);
  present.add(Fault::kEncoderStatus, status_failure_);
  return present;
}

// Compared with the sample before, plausible or not: a value that stays where it jumped to is told
// once. After a silence as long as the time-out nothing is known of where the joint may be.
void EncoderSupervision::check_jump(EncoderSample& sample, FaultSet& present) noexcept {
  const double elapsed_s = std::max(1, periods_without_sample_) * config_.model.period_s;
  const double plausible_rad = config_.safety.encoder_jump_velocity_rad_s * elapsed_s +
                               config_.safety.encoder_jump_margin_rad;
  if (seen_ && periods_without_sample_ < timeout_periods_ &&
      std::abs(sample.angle_rad - angle_rad_) > plausible_rad) {
    sample.verdict = SampleVerdict::kJump;
    present.add(Fault::kEncoderJump);
  }
  seen_ = true;
  angle_rad_ = sample.angle_rad;
  velocity_rad_s_ = sample.velocity_rad_s;
}

void EncoderSupervision::check_frozen(const EncoderSample& sample, std::int32_t elapsed_periods,
                                      double command_V) noexcept {
  if (!seen_ || sample.angle_rad != angle_rad_ || sample.velocity_rad_s != velocity_rad_s_) {
    command_at_change_V_ = command_V;
    frozen_periods_ = 0;
  } else if (std::abs(command_V - command_at_change_V_) > config_.safety.encoder_frozen_command_V) {
    frozen_periods_ = std::min(frozen_periods_ + elapsed_periods, frozen_limit_periods_);
  }
}

Fault EncoderSupervision::cause_of_silence() const noexcept {
  switch (verdict_since_sample_) {
    case SampleVerdict::kBadCrc:
      return Fault::kEncoderCrc;
    case SampleVerdict::kWrongLength:
      return Fault::kEncoderLength;
    case SampleVerdict::kOutOfRange:
      return Fault::kEncoderOutOfRange;
    case SampleVerdict::kDuplicate:
      return Fault::kEncoderFrozen;
    case SampleVerdict::kValid:
    case SampleVerdict::kMissing:
    case SampleVerdict::kJump:
      break;
  }
  return Fault::kEncoderTimeout;
}

}  // namespace eampc::control
