#include "law_design/step_timing.hpp"

#include <chrono>
#include <stdexcept>

#include "control/encoder_codec.hpp"

namespace eampc::law_design {
namespace {

using Clock = std::chrono::steady_clock;
using Rows = std::vector<SimulatedCycle>;

double seconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

// The whole control cycle, fed the frames of a run.
class CycleReplay {
 public:
  CycleReplay(const control::ControllerConfig& config, const RunPlan& plan, const Rows& rows)
      : plan_(plan), cycle_(config) {
    frames_.reserve(rows.size());
    for (const SimulatedCycle& row : rows) {
      // What was decoded stands on the frame's grid: encoded again it gives the same bits.
      frames_.push_back(control::encode_encoder_frame(config.encoder, row.record.sample.angle_rad,
                                                      row.record.sample.velocity_rad_s,
                                                      frames_.size(), 0));
    }
  }

  double step(std::size_t k) {
    control::CycleInput input;
    input.encoder_frame = &frames_[k];
    if (k == 0) input.new_reference = &plan_.reference;
    if (k == static_cast<std::size_t>(plan_.arm_at_cycle)) {
      input.action = control::OperatorAction::kArm;
    }
    return cycle_.step(input).record.law.u;
  }

 private:
  const RunPlan& plan_;
  std::vector<control::Frame> frames_;
  control::ControlCycle cycle_;
};

// Its stages 2 to 4 alone, in its order, fed the decoded samples of a run.
class EstimatorsAndLawReplay {
 public:
  EstimatorsAndLawReplay(const control::ControllerConfig& config, const Rows& rows)
      : state_estimator_(config), disturbance_estimator_(config), law_(config) {
    inputs_.reserve(rows.size());
    double u_on_valves = 0.0;
    for (const SimulatedCycle& row : rows) {
      const bool active = row.record.mode == control::Mode::kActive;
      inputs_.push_back({row.record.sample, row.record.reference, u_on_valves,
                         active && !(inputs_.empty() || inputs_.back().active), active});
      const control::ValveVoltages& valves = row.record.valves;
      u_on_valves =
          valves.enable ? (valves.u1_V - valves.u2_V) / (2.0 * config.valve.control_gain_V) : 0.0;
    }
  }

  double step(std::size_t k) {
    const Input& input = inputs_[k];
    disturbance_estimator_.predict(input.u_on_valves);
    state_estimator_.predict(input.u_on_valves, disturbance_estimator_.for_prediction());
    if (input.enters_active) disturbance_estimator_.enter_active();
    const control::StateEstimate state = state_estimator_.correct(input.sample);
    const control::DisturbanceEstimate disturbance = disturbance_estimator_.update(state);
    return input.active ? law_.decide(state, disturbance, input.reference).u : 0.0;
  }

 private:
  struct Input {
    control::EncoderSample sample;
    control::Reference reference;
    double u_on_valves;
    bool enters_active;
    bool active;
  };

  std::vector<Input> inputs_;
  control::StateEstimator state_estimator_;
  control::DisturbanceEstimator disturbance_estimator_;
  control::ExplicitLaw law_;
};

void require_same(double u, double expected) {
  if (u != expected) {
    throw std::runtime_error("a replayed controller differs from the simulated one");
  }
}

// `fresh` makes a replay; each pass has its own.
template <typename Fresh>
StepTiming time_replay(const Rows& rows, std::size_t lead, Fresh fresh) {
  StepTiming timing;
  timing.steps_s.reserve(rows.size() - lead);
  auto one_by_one = fresh();
  for (std::size_t k = 0; k < lead; ++k) one_by_one.step(k);
  for (std::size_t k = lead; k < rows.size(); ++k) {
    const Clock::time_point before = Clock::now();
    const double u = one_by_one.step(k);
    timing.steps_s.push_back(seconds_between(before, Clock::now()));
    require_same(u, rows[k].record.law.u);
  }

  auto together = fresh();
  for (std::size_t k = 0; k < lead; ++k) together.step(k);
  double u_sum = 0.0;  // read below, so that no step can be left out
  const Clock::time_point start = Clock::now();
  for (std::size_t k = lead; k < rows.size(); ++k) u_sum += together.step(k);
  timing.total_s = seconds_between(start, Clock::now());
  double expected = 0.0;
  for (std::size_t k = lead; k < rows.size(); ++k) expected += rows[k].record.law.u;
  require_same(u_sum, expected);
  return timing;
}

}  // namespace

ControllerTiming time_steps(const control::ControllerConfig& config, const PlantParameters& plant,
                            const RunPlan& plan) {
  const Rows rows = simulate(config, plant, plan);
  const auto lead = static_cast<std::size_t>(lead_cycles(config, plan.arm_at_cycle));
  return {
      time_replay(rows, lead, [&] { return EstimatorsAndLawReplay(config, rows); }),
      time_replay(rows, lead, [&] { return CycleReplay(config, plan, rows); }),
  };
}

}  // namespace eampc::law_design
