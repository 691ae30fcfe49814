// Judges every command frame by its bytes, not by what the controller says of itself. In: valve
// frames in the order they were sent → out: what the node does with each, and how many broke the
// voltage range or the slew limit.
#pragma once

#include <cmath>
#include <cstdint>

#include "control/controller_config.hpp"
#include "control/valve_codec.hpp"

namespace eampc::law_design {

class FrameJudge {
 public:
  // Keeps a reference to the configuration.
  explicit FrameJudge(const control::ControllerConfig& config)
      : layout_(config.valve_command),
        valve_(config.valve),
        step_V_(config.valve.slew_max_V_per_s * config.model.period_s + kTolerance_V) {}

  // A frame that is wrong breaks the range: nobody knows what its voltages are. The node then
  // stands at its safe value, as it does without the enable bit.
  control::ValveVoltages judge(const control::Frame& command) {
    const control::ValveVoltages safe{valve_.safe_V, valve_.safe_V, false};
    control::ValveVoltages now;
    if (!control::decode_valve_frame(layout_, command, now)) {
      ++range_violations_;
      last_ = safe;
      return safe;
    }
    if (outside(now.u1_V) || outside(now.u2_V)) ++range_violations_;
    // To and from a disabled node there is no step.
    if (now.enable && last_.enable &&
        (jumped(now.u1_V, last_.u1_V) || jumped(now.u2_V, last_.u2_V))) {
      ++slew_violations_;
    }
    last_ = now;
    return now.enable ? now : safe;
  }

  std::int64_t range_violations() const { return range_violations_; }
  std::int64_t slew_violations() const { return slew_violations_; }

 private:
  // Bounds come from sums of doubles; this much past them is rounding (as in the valve codec).
  static constexpr double kTolerance_V = 1e-9;

  bool outside(double v) const {
    return !(v >= valve_.min_V - kTolerance_V && v <= valve_.max_V + kTolerance_V);
  }
  bool jumped(double v, double before) const { return !(std::abs(v - before) <= step_V_); }

  const control::ValveCommandLayout& layout_;
  const control::ValveConfig& valve_;
  double step_V_;
  control::ValveVoltages last_{};
  std::int64_t range_violations_ = 0;
  std::int64_t slew_violations_ = 0;
};

}  // namespace eampc::law_design
