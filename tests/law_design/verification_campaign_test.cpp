#include "law_design/verification_campaign.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "control/reference_joint.hpp"
#include "control/valve_codec.hpp"
#include "law_design/frame_judge.hpp"
#include "law_design/joint_integrator.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/trial_generator.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

constexpr double kPeriod_s = 0.005;
constexpr double kTwoPi = 2.0 * std::numbers::pi;

// The reference rig's numbers and its tolerances by hand.
Campaign reference_campaign() {
  Campaign campaign;
  campaign.nominal = reference_plant();
  campaign.tolerances = {0.2, 0.2, 0.2, 0.5, 0.5};
  campaign.ranges = {60.0, 200.0, 0.5, 1.5, 0.8, 0.6, 2.0, 5e-5, 5e-4};
  campaign.angle_bound_rad = 1.0;
  campaign.velocity_bound_rad_s = 6.0;
  campaign.duration_s = 1.0;
  return campaign;
}

struct VerificationCampaign : testing::Test {
  VerificationCampaign() : joint(control::reference_joint()) { control::connect(joint); }

  control::ReferenceJoint joint;
  Campaign campaign = reference_campaign();
};

void expect_equal(const TrialOutcome& a, const TrialOutcome& b) {
  EXPECT_EQ(a.index, b.index);
  EXPECT_EQ(a.angle_rad, b.angle_rad);
  EXPECT_EQ(a.velocity_rad_s, b.velocity_rad_s);
  EXPECT_EQ(a.tracking_error_rad, b.tracking_error_rad);
  EXPECT_EQ(a.rms_error_rad, b.rms_error_rad);
  EXPECT_EQ(a.velocity_violations, b.velocity_violations);
  EXPECT_EQ(a.saturated, b.saturated);
  EXPECT_EQ(a.closed_loop_cycles, b.closed_loop_cycles);
}

TEST_F(VerificationCampaign, NeitherThreadsNorRangesChangeATrial) {
  const CampaignRun one = run_campaign(joint.config, campaign, 0, 60, 1, {});
  const CampaignRun three = run_campaign(joint.config, campaign, 0, 60, 3, {});
  const CampaignRun tail = run_campaign(joint.config, campaign, 41, 19, 2, {});
  ASSERT_EQ(three.outcomes.size(), 60u);
  for (std::size_t i = 0; i < 60; ++i) {
    expect_equal(one.outcomes[i], three.outcomes[i]);
    if (i >= 41) expect_equal(one.outcomes[i], tail.outcomes[i - 41]);
  }
  EXPECT_GT(one.thread_seconds, 0.0);
}

TEST_F(VerificationCampaign, AReplayIsTheSameTrialWithItsCycles) {
  std::vector<SimulatedCycle> history;
  const TrialOutcome replayed = run_trial(joint.config, campaign, 17, &history);
  expect_equal(replayed, run_campaign(joint.config, campaign, 17, 1, 1, {}).outcomes[0]);
  // Arming: 2 cycles and 0.5 s.
  ASSERT_EQ(history.size(), 102u + 200u);
  EXPECT_EQ(replayed.cycles, 302);
  EXPECT_EQ(replayed.closed_loop_cycles, 200);
  EXPECT_EQ(history[101].record.mode, control::Mode::kArming);
  EXPECT_EQ(history[102].record.mode, control::Mode::kActive);
  EXPECT_EQ(history[102].time_s, 0.0);
  double angle = 0.0;
  double squares = 0.0;
  for (std::size_t k = 102; k < history.size(); ++k) {
    angle = std::max(angle, std::abs(history[k].truth.angle_rad));
    const double error = history[k].truth.angle_rad - history[k].record.reference.angle_rad;
    squares += error * error;
  }
  EXPECT_NEAR(replayed.angle_rad, angle, 0.01);  // within a period it may be a little more
  EXPECT_NEAR(replayed.rms_error_rad, std::sqrt(squares / 200.0), 1e-12);
}

TEST_F(VerificationCampaign, TheLawTracksRandomPlantsWithinTheVoltages) {
  campaign.ranges.disturbance_rad_s2 = 20.0;
  const CampaignRun run = run_campaign(joint.config, campaign, 0, 200, 2, {});
  std::int64_t saturated = 0;
  for (const TrialOutcome& outcome : run.outcomes) {
    EXPECT_EQ(outcome.range_violations, 0) << outcome.index;
    EXPECT_EQ(outcome.slew_violations, 0) << outcome.index;
    EXPECT_EQ(outcome.non_finite, 0) << outcome.index;
    EXPECT_EQ(outcome.fault, 0) << outcome.index;
    saturated += outcome.saturated;
  }
  EXPECT_GT(saturated, 0);
}

TEST_F(VerificationCampaign, AStateBoundThatIsTooTightIsCounted) {
  campaign.angle_bound_rad = 1e-6;
  const TrialOutcome outcome = run_trial(joint.config, campaign, 3, nullptr);
  EXPECT_GT(outcome.angle_violations, 190);
  EXPECT_EQ(outcome.velocity_violations > 0, outcome.velocity_rad_s > 6.0);
}

TEST_F(VerificationCampaign, ANonFiniteLawIsCounted) {
  joint.config.law.u_min = joint.config.law.u_max = std::nan("");
  joint.config.model.b = std::nan("");
  const TrialOutcome outcome = run_trial(joint.config, campaign, 0, nullptr);
  EXPECT_GT(outcome.non_finite, 0);
  EXPECT_EQ(outcome.fault, static_cast<std::int64_t>(control::Fault::kNotFinite));
}

TEST_F(VerificationCampaign, ProgressCancelsAndItsExceptionsArriveHere) {
  campaign.duration_s = 60.0;
  EXPECT_THROW(
      run_campaign(joint.config, campaign, 0, 1'000'000, 2, [](int, int) { return false; }),
      Cancelled);
  EXPECT_THROW(run_campaign(joint.config, campaign, 0, 1'000'000, 2,
                            [](int, int) -> bool { throw std::runtime_error("stop"); }),
               std::runtime_error);
}

// b and b1 of (9) from the drawn muscles, over J: exactly the drawn factors, within the tolerances.
TEST(VerificationTrial, PlantsStayWithinTheTolerancesAndReachThem) {
  const Campaign campaign = reference_campaign();
  std::array<double, 5> least, most;
  least.fill(10.0);
  most.fill(0.0);
  int corners = 0;
  for (std::uint64_t i = 0; i < 4000; ++i) {
    const PlantParameters p = draw_trial(campaign, i, kPeriod_s, 0.5).plant;
    const double e0 = 0.1;
    const std::array<double, 5> factors = {
        p.moment_of_inertia_kg_m2 / 0.05,
        (p.k1_N_per_MPa * e0 * e0 + p.k2_N_per_MPa * e0 + p.k3_N_per_MPa) / 950.0,
        (2.0 * p.k1_N_per_MPa * e0 + p.k2_N_per_MPa) / -5500.0,
        p.viscous_damping_N_m_s_rad / 0.5,
        p.valve_time_constant_s / 0.03,
    };
    const std::array<double, 5> tolerance = {0.2, 0.2, 0.2, 0.5, 0.5};
    bool corner = true;
    for (std::size_t j = 0; j < 5; ++j) {
      ASSERT_LE(std::abs(factors[j] - 1.0), tolerance[j] + 1e-12);
      corner &= std::abs(factors[j] - 1.0) > tolerance[j] - 1e-12;
      least[j] = std::min(least[j], factors[j]);
      most[j] = std::max(most[j], factors[j]);
    }
    corners += corner;
    ASSERT_LE(std::abs(p.initial_angle_rad), 0.5);
    ASSERT_LE(p.encoder_noise_rad, 5e-5);
  }
  EXPECT_NEAR(least[0], 0.8, 1e-9);
  EXPECT_NEAR(most[4], 1.5, 1e-9);
  EXPECT_NEAR(corners, 1000, 150);
}

TEST(VerificationTrial, DisturbancesAndReferencesKeepTheirRanges) {
  const Campaign campaign = reference_campaign();
  double most = 0.0;
  double fastest = 0.0;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    const Trial trial = draw_trial(campaign, i, kPeriod_s, 0.5);
    const TrialDisturbance& d = trial.disturbance;
    const auto at = [&](double t) {
      const double begin = kPeriod_s * static_cast<double>(d.ramp_begin);
      const double end = kPeriod_s * static_cast<double>(d.ramp_end);
      const double share = std::clamp((t - begin) / (end - begin), 0.0, 1.0);
      return d.first_level_rad_s2 + share * (d.last_level_rad_s2 - d.first_level_rad_s2) +
             d.sine_rad_s2 * std::sin(kTwoPi * d.frequency_hz * t + d.phase_rad);
    };
    for (double t = 0.0; t < 1.0; t += 0.001) {
      most = std::max(most, std::abs(at(t)));
      fastest = std::max(fastest, std::abs(at(t + 0.001) - at(t)) / 0.001);
    }
    const control::ReferenceTrajectory& r = trial.reference;
    const bool sine = r.kind == control::ReferenceKind::kSine;
    ASSERT_LE(std::abs(r.offset_rad) + (sine ? r.amplitude_rad : 0.0), 0.8 + 1e-12);
    ASSERT_LE(std::abs(r.offset_rad + r.amplitude_rad), 0.8 + 1e-12);
    ASSERT_LE(std::abs(r.amplitude_rad), 0.6 + 1e-12);
    ASSERT_LE(sine ? kTwoPi * r.frequency_hz * r.amplitude_rad : 0.0, 2.0 + 1e-12);
  }
  EXPECT_LE(most, 60.0 + 1e-9);
  EXPECT_GT(most, 50.0);
  EXPECT_LE(fastest, 200.0 + 1e-6);
  EXPECT_GT(fastest, 180.0);
}

TEST(TrialGenerator, MomentsAndStreams) {
  double sum = 0.0, squares = 0.0, normal_sum = 0.0, normal_squares = 0.0, cross = 0.0;
  constexpr int kDraws = 200'000;
  TrialGenerator random(7, 11), neighbour(7, 12);
  for (int i = 0; i < kDraws; ++i) {
    const double u = random.uniform();
    ASSERT_GE(u, 0.0);
    ASSERT_LT(u, 1.0);
    sum += u;
    squares += u * u;
    cross += (u - 0.5) * (neighbour.uniform() - 0.5);
    const auto [a, b] = random.normal_pair();
    normal_sum += a + b;
    normal_squares += a * a + b * b;
  }
  // Five standard errors of each mean.
  EXPECT_NEAR(sum / kDraws, 0.5, 5.0 * 0.2887 / std::sqrt(kDraws));
  EXPECT_NEAR(squares / kDraws, 1.0 / 3.0, 5.0 * 0.2981 / std::sqrt(kDraws));
  EXPECT_NEAR(cross / kDraws, 0.0, 5.0 * 0.0834 / std::sqrt(kDraws));
  EXPECT_NEAR(normal_sum / (2 * kDraws), 0.0, 5.0 / std::sqrt(2.0 * kDraws));
  EXPECT_NEAR(normal_squares / (2 * kDraws), 1.0, 5.0 * 1.4142 / std::sqrt(2.0 * kDraws));
}

// Against the other plant (its own torque formula, libm at every stage) at 400 steps per period:
// the tolerances' corners, ramps between extreme voltages, a fast disturbance, one second.
TEST(JointIntegrator, AgreesWithAFineReferenceToAMicroradian) {
  control::ControllerConfig config;
  control::set_reference_frames(config);
  Campaign campaign = reference_campaign();
  double worst_rad = 0.0;
  for (std::uint64_t i = 0; i < 40; ++i) {
    PlantParameters plant = draw_trial(campaign, i, kPeriod_s, 0.5).plant;
    plant.disturbance = {{DisturbanceKind::kConstant, -15.0}, {DisturbanceKind::kSine, 45.0, 10.0}};
    JointIntegrator ours(plant, kPeriod_s, 10.0);
    plant.substeps = 400;
    SimulatedJoint fine(plant, kPeriod_s);
    SmoothDisturbance sine{45.0, 1.0, 0.0};
    control::ValveCodec codec(config.valve_command);
    TrialGenerator random(3, i);
    double u1_V = 5.0;
    for (int k = 0; k < 200; ++k) {
      if (k % 8 == 0) u1_V = std::round(10.0 * random.uniform());
      const control::ValveVoltages voltages{u1_V, 10.0 - u1_V, true};
      const auto command = codec.encode({voltages, {0.0, 10.0}, {0.0, 10.0}});
      fine.advance(config.valve_command, command.frame, k * kPeriod_s);
      ours.advance(0.09 * u1_V, 0.09 * (10.0 - u1_V), -15.0, -15.0, sine, true);
      worst_rad = std::max(worst_rad, std::abs(ours.state().angle_rad - fine.state().angle_rad));
    }
    EXPECT_NEAR(ours.state().pressure1_MPa, fine.state().pressure1_MPa, 1e-12);
  }
  EXPECT_LE(worst_rad, 1e-6);
  EXPECT_GT(worst_rad, 0.0);
}

TEST(JointIntegrator, FollowsARampOfTheDisturbanceExactly) {
  PlantParameters plant = reference_campaign().nominal;
  plant.k1_N_per_MPa = plant.k2_N_per_MPa = plant.k3_N_per_MPa = 0.0;
  plant.viscous_damping_N_m_s_rad = 0.0;
  JointIntegrator joint(plant, kPeriod_s, 0.0);
  SmoothDisturbance none;
  for (int k = 0; k < 200; ++k) {
    joint.advance(0.0, 0.0, 6.0 * k * kPeriod_s, 6.0 * (k + 1) * kPeriod_s, none, false);
  }
  EXPECT_NEAR(joint.state().angle_rad, 1.0, 1e-12);       // d = 6 t: θ = t³
  EXPECT_NEAR(joint.state().velocity_rad_s, 3.0, 1e-12);  // θ̇ = 3 t²
}

TEST(JointIntegrator, IdealValvesAndAHeldJoint) {
  PlantParameters plant = reference_campaign().nominal;
  plant.valve_time_constant_s = 0.0;
  JointIntegrator ideal(plant, kPeriod_s, 0.0);
  ideal.advance_held(0.63, 0.27);
  // (F1 − F2) r/J at θ = 0, by hand: 0.36·950·0.025/0.05.
  EXPECT_NEAR(ideal.muscle_acceleration_rad_s2(), 171.0, 1e-9);
  plant.valve_time_constant_s = 0.03;
  JointIntegrator lagging(plant, kPeriod_s, 0.0);
  for (int k = 0; k < 6; ++k) lagging.advance_held(0.9, 0.36);
  EXPECT_NEAR(lagging.state().pressure1_MPa, 0.9 * (1.0 - std::exp(-1.0)), 1e-12);
  EXPECT_NEAR(lagging.state().pressure2_MPa, 0.36 * (1.0 - std::exp(-1.0)), 1e-12);
  EXPECT_EQ(lagging.state().angle_rad, 0.0);
}

TEST(FrameJudge, CountsWhatBreaksRangeOrSlew) {
  control::ReferenceJoint joint = control::reference_joint();
  joint.config.valve.slew_max_V_per_s = 200.0;  // 1 V per period
  FrameJudge judge(joint.config);
  control::ValveCodec codec(joint.config.valve_command);
  const control::VoltageWindow any{-30.0, 30.0};
  const auto frame = [&](double u1_V, double u2_V, bool enable = true) {
    return codec.encode({{u1_V, u2_V, enable}, any, any}).frame;
  };
  EXPECT_EQ(judge.judge(frame(5.0, 5.0)).u1_V, 5.0);  // from a disabled node: no step
  judge.judge(frame(6.0, 4.0));
  EXPECT_EQ(judge.range_violations(), 0);
  EXPECT_EQ(judge.slew_violations(), 0);
  judge.judge(frame(6.0, 5.001));
  EXPECT_EQ(judge.slew_violations(), 1);
  judge.judge(frame(6.0, 5.0, false));
  judge.judge(frame(10.001, 5.0));
  EXPECT_EQ(judge.range_violations(), 1);
  judge.judge(frame(10.0, -0.001));
  EXPECT_EQ(judge.range_violations(), 2);
  EXPECT_EQ(judge.slew_violations(), 2);
  control::Frame torn = frame(9.0, 0.0);
  torn.data[0] = static_cast<std::uint8_t>(torn.data[0] ^ 1);
  EXPECT_FALSE(judge.judge(torn).enable);
  EXPECT_EQ(judge.range_violations(), 3);
}

}  // namespace
}  // namespace eampc::law_design
