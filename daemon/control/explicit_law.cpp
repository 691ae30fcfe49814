#include "control/explicit_law.hpp"

#include <algorithm>
#include <cmath>

namespace eampc::control {
namespace {

// Relative width of "at the end of the range": a saturated piece gives its bound up to rounding
// only.
constexpr double kRangeTolerance = 1e-9;

bool clamp_onto(double& value, double lower, double upper) noexcept {
  const double clamped = std::clamp(value, lower, upper);
  const bool moved = clamped != value && value == value;
  value = clamped;
  return moved;
}

}  // namespace

LawOutput ExplicitLaw::at(ParameterVector p) const noexcept {
  const LawConfig& law = config_.law;
  LawOutput output;
  for (std::size_t i = 0; i < static_cast<std::size_t>(law.packed.n_parameters); ++i) {
    output.parameter_clamped |= clamp_onto(p[i], law.lower[i], law.upper[i]);
  }
  const LawValue value = evaluate(law.packed, p.data());
  output.region = value.piece;
  // Clipping would hide an infinite value from the finite check of safety.
  output.u = std::isfinite(value.u) ? std::clamp(value.u, law.u_min, law.u_max) : value.u;
  const double margin = kRangeTolerance * (law.u_max - law.u_min);
  output.at_range_end = value.u >= law.u_max - margin || value.u <= law.u_min + margin;
  return output;
}

LawOutput ExplicitLaw::decide(const StateEstimate& state, const DisturbanceEstimate& disturbance,
                              const Reference& reference) const noexcept {
  const LawConfig& law = config_.law;
  if (law.formulation == Formulation::kPaper) {
    return at({state.x[0], state.x[1], disturbance.for_law[0], disturbance.for_law[1],
               reference.angle_rad});
  }
  const DiscreteModel& model = config_.model;
  const bool has_valve_state = model.order == 3;
  const std::size_t i_u_ss = has_valve_state ? 3 : 2;
  double u_ss = (reference.acceleration_rad_s2 - model.b1 * reference.angle_rad -
                 model.b2 * reference.velocity_rad_s - disturbance.for_law[1]) /
                model.b;
  const bool u_ss_clamped = clamp_onto(u_ss, law.lower[i_u_ss], law.upper[i_u_ss]);
  ParameterVector p{};
  p[0] = state.x[0] - reference.angle_rad;
  p[1] = state.x[1] - reference.velocity_rad_s;
  if (has_valve_state) {
    p[2] = state.x[2] - u_ss;
  }
  p[i_u_ss] = u_ss;
  p[i_u_ss + 1] = reference.angle_rad;
  p[i_u_ss + 2] = reference.velocity_rad_s;
  LawOutput output = at(p);
  output.parameter_clamped |= u_ss_clamped;
  return output;
}

}  // namespace eampc::control
