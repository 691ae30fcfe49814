#include "law_design/step_timing.hpp"

#include <time.h>

#include <stdexcept>
#include <vector>

#include "control/encoder_codec.hpp"
#include "law_design/offline_config.hpp"

namespace eampc::law_design {
namespace {

using Rows = std::vector<SimulatedCycle>;

// Other programs of a busy machine do not count.
double processor_time_s() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
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
    input.bus.queue_proved_empty = true;  // no bus between
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
      const bool active = row.record.law.region >= 0;
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
    if (input.enters_active) disturbance_estimator_.law_begins();
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

double time_replay(const Rows& rows, std::size_t lead, auto replay) {
  for (std::size_t k = 0; k < lead; ++k) replay.step(k);
  std::vector<double> u(rows.size() - lead);
  const double start_s = processor_time_s();
  for (std::size_t k = lead; k < rows.size(); ++k) u[k - lead] = replay.step(k);
  const double taken_s = processor_time_s() - start_s;
  for (std::size_t k = lead; k < rows.size(); ++k) {
    if (u[k - lead] != rows[k].record.law.u) {
      throw std::runtime_error("a replayed controller differs from the simulated one");
    }
  }
  return taken_s;
}

}  // namespace

ControllerTiming time_steps(const control::ControllerConfig& daemon_config,
                            const PlantParameters& plant, const RunPlan& plan) {
  const control::ControllerConfig config = offline_config(daemon_config);
  const Rows rows = simulate(config, plant, plan);
  const auto lead = static_cast<std::size_t>(lead_cycles(config, plan.arm_at_cycle));
  return {
      time_replay(rows, lead, EstimatorsAndLawReplay(config, rows)),
      time_replay(rows, lead, CycleReplay(config, plan, rows)),
  };
}

}  // namespace eampc::law_design
