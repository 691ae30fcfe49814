// Reference (θ_r, θ̇_r, θ̈_r) at a scenario time. In: seconds since the mode became ACTIVE. Out: rad,
// rad/s, rad/s². Cost: one sine, or one table look-up. A step has no derivatives; a table is
// differentiated when it is loaded, not here.
#pragma once

#include <cstdint>

#include "control/control_types.hpp"

namespace eampc::control {

enum class ReferenceKind : std::uint8_t { kConstant, kStep, kSine, kTable, kExternal };

struct ReferenceTrajectory {
  ReferenceKind kind = ReferenceKind::kConstant;
  double amplitude_rad = 0.0;  // constant: its value; step: its height; sine: its amplitude
  double offset_rad = 0.0;     // step and sine: value it starts from
  double start_s = 0.0;        // step, sine
  double frequency_hz = 0.0;   // sine
  // kTable: `samples` rows on the grid of `sample_period_s`, linear between rows, held after the
  // last.
  const Reference* table = nullptr;  // owned by the service for as long as the daemon lives
  std::int32_t samples = 0;
  double sample_period_s = 0.0;
  Reference external{};  // kExternal: the last sample that came in by LCM
};

Reference reference_at(const ReferenceTrajectory& trajectory, double time_s) noexcept;

// Clamps the angle onto ± angle_max_rad and, where it does, the derivatives to zero. True: it did.
// An angle that is not a number stays so: the finite check of safety stops on it.
bool clamp_reference(Reference& reference, double angle_max_rad) noexcept;

}  // namespace eampc::control
