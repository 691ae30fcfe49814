// Times of the configuration in whole periods.
#pragma once

#include <cmath>
#include <cstdint>

namespace eampc::control {

// Rounded to nearest.
inline std::int32_t periods_in(double duration_s, double period_s) noexcept {
  return static_cast<std::int32_t>(std::round(duration_s / period_s));
}

}  // namespace eampc::control
