#include "control/safety.hpp"

#include <algorithm>
#include <cmath>

namespace eampc::control {

Safety::Safety(const ControllerConfig& config) noexcept
    : config_(config), detection_(config), machine_(config), guard_(config) {}

SafetyState Safety::state() const noexcept {
  SafetyState state;
  state.mode = machine_.mode();
  state.fault = machine_.fault();
  state.present_faults = present_;
  state.refusal = machine_.refusal();
  state.refusal_cause = machine_.refusal_cause();
  state.law_acts = machine_.law_acts();
  state.law_begins = law_begins_;
  if (state.mode == Mode::kActive) {
    state.scenario_time_s = static_cast<double>(machine_.active_periods()) * config_.model.period_s;
  }
  return state;
}

SafetyState Safety::advance(const SafetyInput& input, EncoderSample& sample) noexcept {
  same_period_ = input.elapsed_periods == 0;
  const bool acted = machine_.law_acts();
  present_ = detection_.check(sample, input.monitor, input.bus, input.elapsed_periods,
                              guard_.last(), acted);
  // One refused or unconfirmed frame is no fault yet, but no moment to arm either.
  const bool queue_proved_empty =
      input.bus.queue_proved_empty && !input.bus.send_refused && input.bus.unconfirmed_periods == 0;
  machine_.advance(present_, input.action, sample.verdict == SampleVerdict::kValid,
                   queue_proved_empty, input.elapsed_periods, guard_.last());
  law_begins_ = machine_.law_acts() && !acted;
  return state();
}

SafetyDecision Safety::decide(const StateEstimate& state, const DisturbanceEstimate& disturbance,
                              const LawOutput& law) noexcept {
  bool finite = !machine_.law_acts() || std::isfinite(law.u);
  for (const double x : state.x) finite &= std::isfinite(x);
  for (const double d : disturbance.for_law) finite &= std::isfinite(d);
  if (!finite) {
    present_.add(Fault::kNotFinite);
    machine_.raise(present_, guard_.last());
  }

  SafetyDecision decision;
  const ValveConfig& valve = config_.valve;
  switch (machine_.mode()) {
    case Mode::kInit:
    case Mode::kDisarmed:
    case Mode::kFault:
      decision.demand = guard_.safe(same_period_);
      return decision;
    case Mode::kArming:
    case Mode::kActive:
    case Mode::kSoftStop:
      break;
  }
  const bool reduced = machine_.limits_are_reduced();
  if (reduced) decision.limits |= kLimitReduced;
  const double slew_V_per_s =
      reduced ? std::min(valve.slew_max_V_per_s, config_.safety.reduced_slew_V_per_s)
              : valve.slew_max_V_per_s;
  const ValveVoltages wanted =
      machine_.law_acts() ? law_voltages(law, decision.limits) : machine_.ramp_voltages();
  decision.demand = guard_.guard(wanted, slew_V_per_s, same_period_, decision.limits);
  return decision;
}

ValveVoltages Safety::law_voltages(const LawOutput& law, std::uint32_t& limits) const noexcept {
  const ValveConfig& valve = config_.valve;
  if (law.at_range_end) limits |= kLimitControlRange;
  if (law.parameter_clamped) limits |= kLimitParameterBox;
  double u = law.u;
  if (machine_.limits_are_reduced()) {
    const double share = config_.safety.reduced_control_share;
    u = std::clamp(u, share * config_.law.u_min, share * config_.law.u_max);
    if (u != law.u) limits |= kLimitControlRange;
  }
  return {valve.bias_V + valve.control_gain_V * u, valve.bias_V - valve.control_gain_V * u, true};
}

}  // namespace eampc::control
