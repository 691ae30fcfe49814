// In: the decoded encoder sample, periods passed, the command that was on the valves (V) → out:
// which of the causes 1 to 8 hold. |Δθ| > ω_jump · Δt + margin is a jump; a value is frozen if θ
// and θ̇ stay the same bit for bit while (u1 − u2)/2 stands further than encoder_frozen_command_V
// from where it was at their last change, for encoder_frozen_s in all, the law acting: a joint at
// rest under a constant command never is, nor one in a stop, however noiseless its encoder. A
// counter that does not move on (duplicates only) is frozen after encoder_timeout_s. Cost:
// constant. Absent: any action.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

class EncoderSupervision {
 public:
  explicit EncoderSupervision(const ControllerConfig& config) noexcept;

  // Before the estimators: a valid sample that jumps becomes SampleVerdict::kJump.
  // `sent`: the last command, the law's if `law_acts`.
  FaultSet check(EncoderSample& sample, std::int32_t elapsed_periods, const ValveVoltages& sent,
                 bool law_acts) noexcept;

 private:
  void check_jump(EncoderSample& sample, FaultSet& present) noexcept;
  void check_frozen(const EncoderSample& sample, std::int32_t elapsed_periods,
                    double command_V) noexcept;
  Fault cause_of_silence() const noexcept;

  const ControllerConfig& config_;
  const std::int32_t timeout_periods_;
  const std::int32_t frozen_limit_periods_;

  bool seen_ = false;  // a decodable sample, ever
  double angle_rad_ = 0.0;
  double velocity_rad_s_ = 0.0;
  std::int32_t periods_without_sample_ = 0;
  std::int32_t invalid_run_ = 0;  // frames
  SampleVerdict verdict_since_sample_ = SampleVerdict::kMissing;
  bool status_failure_ = false;
  double command_at_change_V_ = 0.0;
  std::int32_t frozen_periods_ = 0;
};

}  // namespace eampc::control
