// References that come in by LCM are from anybody on the network: clamped to the reference range,
// at most one per control period, and expiring. Time is handed in, so that a test owns it.
#pragma once

#include <cstdint>
#include <optional>

#include "control/control_types.hpp"

namespace eampc::service {

class ExternalReference {
 public:
  // A sample older than this, or stamped further than this into the future, is not obeyed: 20
  // periods of a 100 Hz sender, far less than a person needs to notice that it died.
  static constexpr std::int64_t kExpiryUs = 200'000;

  ExternalReference(double angle_max_rad, double period_s);

  // What the loop is to follow now, or nothing if the sample is refused.
  std::optional<control::Reference> accept(const control::Reference& sample,
                                           std::int64_t sample_utime, std::int64_t now_us);
  // Once after the samples stopped: the last angle, standing still.
  std::optional<control::Reference> expire(std::int64_t now_us);

 private:
  const double angle_max_rad_;
  const std::int64_t period_us_;
  std::optional<control::Reference> followed_;
  std::int64_t followed_since_us_ = 0;
};

}  // namespace eampc::service
