#include "service/external_reference.hpp"

#include <algorithm>
#include <cmath>

namespace eampc::service {

ExternalReference::ExternalReference(double angle_max_rad, double period_s)
    : angle_max_rad_(angle_max_rad), period_us_(std::llround(1e6 * period_s)) {}

std::optional<control::Reference> ExternalReference::accept(const control::Reference& sample,
                                                            std::int64_t sample_utime,
                                                            std::int64_t now_us) {
  if (!std::isfinite(sample.angle_rad) || !std::isfinite(sample.velocity_rad_s) ||
      !std::isfinite(sample.acceleration_rad_s2)) {
    return std::nullopt;
  }
  // Compared without a difference: the stamp may be any 64-bit number.
  if (sample_utime < now_us - kExpiryUs || sample_utime > now_us + kExpiryUs) return std::nullopt;
  // A clock that was set back says nothing about the rate.
  const std::int64_t followed_for_us = now_us - followed_since_us_;
  if (followed_ && followed_for_us >= 0 && followed_for_us < period_us_) return std::nullopt;
  control::Reference reference = sample;
  if (std::fabs(sample.angle_rad) > angle_max_rad_) {
    reference = {std::clamp(sample.angle_rad, -angle_max_rad_, angle_max_rad_), 0.0, 0.0};
  }
  followed_ = reference;
  followed_since_us_ = now_us;
  return reference;
}

std::optional<control::Reference> ExternalReference::expire(std::int64_t now_us) {
  const std::int64_t followed_for_us = now_us - followed_since_us_;
  // Set back, the clock cannot tell the age any more: stand still now rather than an hour later.
  if (!followed_ || (followed_for_us >= 0 && followed_for_us < kExpiryUs)) return std::nullopt;
  const control::Reference held{followed_->angle_rad, 0.0, 0.0};
  followed_.reset();
  return held;
}

}  // namespace eampc::service
