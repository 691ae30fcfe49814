#include "control/reference_trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace eampc::control {
namespace {

// A start that lies on the grid of k·T must not slip by a period because the product is one
// rounding short.
constexpr double kGridTolerance_s = 1e-9;

Reference interpolated(const Reference& a, const Reference& b, double share) noexcept {
  return {a.angle_rad + share * (b.angle_rad - a.angle_rad),
          a.velocity_rad_s + share * (b.velocity_rad_s - a.velocity_rad_s),
          a.acceleration_rad_s2 + share * (b.acceleration_rad_s2 - a.acceleration_rad_s2)};
}

Reference table_at(const ReferenceTrajectory& trajectory, double time_s) noexcept {
  if (trajectory.table == nullptr || trajectory.samples < 1 ||
      !(trajectory.sample_period_s > 0.0)) {
    return {};
  }
  const double row = std::max(0.0, time_s / trajectory.sample_period_s);
  const std::int32_t last = trajectory.samples - 1;
  if (row >= static_cast<double>(last)) {
    Reference held = trajectory.table[last];
    if (row * trajectory.sample_period_s >
        static_cast<double>(last) * trajectory.sample_period_s + kGridTolerance_s) {
      held.velocity_rad_s = 0.0;  // an angle at rest has no derivatives
      held.acceleration_rad_s2 = 0.0;
    }
    return held;
  }
  const auto index = static_cast<std::int32_t>(row);
  return interpolated(trajectory.table[index], trajectory.table[index + 1],
                      row - static_cast<double>(index));
}

}  // namespace

Reference reference_at(const ReferenceTrajectory& trajectory, double time_s) noexcept {
  switch (trajectory.kind) {
    case ReferenceKind::kConstant:
      return {trajectory.amplitude_rad, 0.0, 0.0};
    case ReferenceKind::kStep:
      return {
          trajectory.offset_rad +
              (time_s + kGridTolerance_s >= trajectory.start_s ? trajectory.amplitude_rad : 0.0),
          0.0, 0.0};
    case ReferenceKind::kSine: {
      if (time_s + kGridTolerance_s < trajectory.start_s) {
        return {trajectory.offset_rad, 0.0, 0.0};
      }
      const double omega_rad_s = 2.0 * std::numbers::pi * trajectory.frequency_hz;
      const double phase_rad = omega_rad_s * (time_s - trajectory.start_s);
      const double sine = trajectory.amplitude_rad * std::sin(phase_rad);
      const double cosine = trajectory.amplitude_rad * std::cos(phase_rad);
      return {trajectory.offset_rad + sine, omega_rad_s * cosine,
              -omega_rad_s * omega_rad_s * sine};
    }
    case ReferenceKind::kTable:
      return table_at(trajectory, time_s);
    case ReferenceKind::kExternal:
      return trajectory.external;
  }
  return {};
}

bool clamp_reference(Reference& reference, double angle_max_rad) noexcept {
  if (std::abs(reference.angle_rad) <= angle_max_rad) {
    return false;
  }
  reference = {std::clamp(reference.angle_rad, -angle_max_rad, angle_max_rad), 0.0, 0.0};
  return true;
}

}  // namespace eampc::control
