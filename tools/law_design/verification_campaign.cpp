#include "law_design/verification_campaign.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <numeric>

#include "control/encoder_codec.hpp"
#include "law_design/frame_judge.hpp"
#include "law_design/joint_integrator.hpp"
#include "law_design/offline_config.hpp"
#include "law_design/trial_generator.hpp"

namespace eampc::law_design {
namespace {

constexpr int kArmAtCycle = 2;  // the first valid frame has made the daemon DISARMED by then
constexpr std::uint64_t kNoiseStream = 0x6E6F697365u;  // apart from the stream that draws the trial
constexpr std::chrono::milliseconds kProgressPeriod{100};

// The level of d at the beginning of period k from ACTIVE on.
double level_at(const TrialDisturbance& d, std::int64_t k) {
  const double share = std::clamp(
      static_cast<double>(k - d.ramp_begin) / static_cast<double>(d.ramp_end - d.ramp_begin), 0.0,
      1.0);
  return d.first_level_rad_s2 + share * (d.last_level_rad_s2 - d.first_level_rad_s2);
}

double thread_time_s() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

TrialOutcome run_trial(const control::ControllerConfig& daemon_config, const Campaign& campaign,
                       std::uint64_t index, std::vector<SimulatedCycle>* history) {
  const control::ControllerConfig config = offline_config(daemon_config);
  const double T = config.model.period_s;
  const Trial trial = draw_trial(campaign, index, T, lead_cycles(config, 0) * T);
  const PlantParameters& plant = trial.plant;
  const TrialDisturbance& disturbance = trial.disturbance;
  TrialGenerator noise(campaign.seed ^ kNoiseStream, index);
  const bool noisy = plant.encoder_noise_rad > 0.0 || plant.velocity_noise_rad_s > 0.0;

  JointIntegrator joint(plant, T, disturbance.frequency_hz);
  control::ControlCycle controller(config);
  FrameJudge judge(config);
  SmoothDisturbance sine{disturbance.sine_rad_s2, std::cos(disturbance.phase_rad),
                         std::sin(disturbance.phase_rad)};
  SmoothDisturbance no_sine{};
  const double d_at_start = disturbance.first_level_rad_s2 + sine.amplitude_rad_s2 * sine.sine;

  const std::int64_t lead = lead_cycles(config, kArmAtCycle);
  const auto active = static_cast<std::int64_t>(std::round(campaign.duration_s / T));
  const std::int64_t judged_from = active - active / 4;
  const auto target_MPa = [&](double voltage_V) {
    return plant.pressure_gain_MPa_per_V * std::clamp(voltage_V, plant.min_V, plant.max_V);
  };

  TrialOutcome outcome;
  outcome.index = index;
  double squares = 0.0;
  control::CycleInput input;
  input.bus.queue_proved_empty = true;  // no bus between
  for (std::int64_t k = -lead; k < active; ++k) {
    double measured_rad = joint.angle_rad;
    double measured_rad_s = joint.velocity_rad_s;
    if (noisy) {
      const TrialGenerator::Pair n = noise.normal_pair();
      measured_rad += plant.encoder_noise_rad * n.first;
      measured_rad_s += plant.velocity_noise_rad_s * n.second;
    }
    const control::Frame frame = control::encode_encoder_frame(
        config.encoder, measured_rad, measured_rad_s, static_cast<std::uint64_t>(k + lead), 0);
    input.encoder_frame = &frame;
    input.new_reference = k == -lead ? &trial.reference : nullptr;
    input.action =
        k == kArmAtCycle - lead ? control::OperatorAction::kArm : control::OperatorAction::kNone;
    const control::CycleOutput output = controller.step(input);
    const control::CycleRecord& record = output.record;
    const control::ValveVoltages voltages = judge.judge(output.command);
    const double level0 =
        k < 0 ? d_at_start * static_cast<double>(k + lead) / static_cast<double>(lead)
              : level_at(disturbance, k);
    if (history != nullptr) {
      history->push_back({record, static_cast<double>(k) * T, joint.state(),
                          plant.moment_of_inertia_kg_m2 * joint.muscle_acceleration_rad_s2(),
                          level0 + (k < 0 ? 0.0 : sine.amplitude_rad_s2 * sine.sine)});
    }
    if (k >= 0) {
      const double error = joint.angle_rad - record.reference.angle_rad;
      squares += error * error;
      if (k >= judged_from) {
        outcome.tracking_error_rad = std::max(outcome.tracking_error_rad, std::abs(error));
      }
      outcome.outside_box += record.law.parameter_clamped;
      outcome.saturated += record.law.at_range_end;
      outcome.closed_loop_cycles += record.mode == control::Mode::kActive;
    }
    outcome.non_finite += !std::isfinite(record.law.u + joint.angle_rad + joint.velocity_rad_s);

    const double target1 = target_MPa(voltages.u1_V);
    const double target2 = target_MPa(voltages.u2_V);
    if (k >= 0) {
      const auto most =
          joint.advance(target1, target2, level0, level_at(disturbance, k + 1), sine, true);
      outcome.angle_rad = std::max(outcome.angle_rad, most.angle_rad);
      outcome.velocity_rad_s = std::max(outcome.velocity_rad_s, most.velocity_rad_s);
      outcome.angle_violations += most.angle_rad > campaign.angle_bound_rad;
      outcome.velocity_violations += most.velocity_rad_s > campaign.velocity_bound_rad_s;
    } else if (plant.hold_until_start) {
      joint.advance_held(target1, target2);
    } else {
      const double level1 =
          d_at_start * static_cast<double>(k + 1 + lead) / static_cast<double>(lead);
      joint.advance(target1, target2, level0, level1, no_sine, false);
    }
    outcome.fault = static_cast<std::int64_t>(record.fault);
  }
  outcome.range_violations = judge.range_violations();
  outcome.slew_violations = judge.slew_violations();
  outcome.cycles = lead + active;
  outcome.rms_error_rad =
      std::sqrt(squares / static_cast<double>(std::max<std::int64_t>(1, active)));
  return outcome;
}

CampaignRun run_campaign(const control::ControllerConfig& config, const Campaign& campaign,
                         std::uint64_t first, int count, int threads,
                         const LoopProgress& progress) {
  CampaignRun run;
  run.outcomes.resize(static_cast<std::size_t>(count));
  const int used = thread_count(threads);
  std::vector<double> seconds(static_cast<std::size_t>(used));
  const auto work = [&](int i, int thread) {
    const double begin_s = thread_time_s();
    run.outcomes[static_cast<std::size_t>(i)] =
        run_trial(config, campaign, first + static_cast<std::uint64_t>(i), nullptr);
    seconds[static_cast<std::size_t>(thread)] += thread_time_s() - begin_s;
  };
  auto told = std::chrono::steady_clock::now();
  const auto now_and_then = [&](int done, int of) {
    const auto now = std::chrono::steady_clock::now();
    if (now - told < kProgressPeriod) return true;
    told = now;
    return progress(done, of);
  };
  parallel_range(count, used, work, progress ? now_and_then : LoopProgress{});
  run.thread_seconds = std::accumulate(seconds.begin(), seconds.end(), 0.0);
  return run;
}

}  // namespace eampc::law_design
