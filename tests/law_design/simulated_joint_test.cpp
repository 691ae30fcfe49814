#include "law_design/simulated_joint.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "control/encoder_codec.hpp"
#include "control/reference_joint.hpp"
#include "control/valve_codec.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

constexpr double kPeriod_s = 0.005;

// The reference rig with ideal valves.
PlantParameters ideal_plant() {
  PlantParameters plant = reference_plant();
  plant.valve_time_constant_s = 0.0;
  return plant;
}

class SimulatedJointTest : public testing::Test {
 protected:
  SimulatedJointTest() { control::set_reference_frames(config_); }

  void advance(SimulatedJoint& joint, double u1_V, double u2_V, int periods, bool enable = true,
               double from_s = 0.0) {
    control::ValveCodec codec(config_.valve_command);
    for (int k = 0; k < periods; ++k) {
      const auto command = codec.encode({{u1_V, u2_V, enable}, {0.0, 10.0}, {0.0, 10.0}});
      joint.advance(config_.valve_command, command.frame, from_s + k * kPeriod_s);
    }
  }

  control::ControllerConfig config_;
};

// Without muscles a constant d is free fall: θ = ½ d t², θ̇ = d t; RK4 is exact on it.
TEST_F(SimulatedJointTest, FreeFall) {
  PlantParameters plant = ideal_plant();
  plant.k1_N_per_MPa = plant.k2_N_per_MPa = plant.k3_N_per_MPa = 0.0;
  plant.viscous_damping_N_m_s_rad = 0.0;
  plant.disturbance = {{DisturbanceKind::kConstant, 3.0}};
  SimulatedJoint joint(plant, kPeriod_s);
  advance(joint, 0.0, 0.0, 200);
  EXPECT_NEAR(joint.state().angle_rad, 1.5, 1e-12);
  EXPECT_NEAR(joint.state().velocity_rad_s, 3.0, 1e-12);
}

// At θ = 0: (F1 − F2) r = (P1 − P2)(100 − 750 + 1600) r = 0.09·4·950·0.025 = 8.55 N m for 7 V and 3
// V.
TEST_F(SimulatedJointTest, TorqueByHand) {
  PlantParameters plant = ideal_plant();
  plant.hold_until_start = true;
  SimulatedJoint joint(plant, kPeriod_s);
  advance(joint, 7.0, 3.0, 1, true, -1.0);
  EXPECT_NEAR(joint.torque_N_m(), 8.55, 1e-9);
  EXPECT_EQ(joint.state().angle_rad, 0.0);
}

TEST_F(SimulatedJointTest, TheValvesLagIsFirstOrderAndExact) {
  PlantParameters plant = ideal_plant();
  plant.valve_time_constant_s = 0.03;
  plant.hold_until_start = true;
  SimulatedJoint joint(plant, kPeriod_s);
  advance(joint, 10.0, 4.0, 6, true, -1.0);
  EXPECT_NEAR(joint.state().pressure1_MPa, 0.9 * (1.0 - std::exp(-1.0)), 1e-12);
  EXPECT_NEAR(joint.state().pressure2_MPa, 0.36 * (1.0 - std::exp(-1.0)), 1e-12);
}

TEST_F(SimulatedJointTest, WithoutTheEnableBitTheNodeIsSafe) {
  SimulatedJoint joint(ideal_plant(), kPeriod_s);
  advance(joint, 8.0, 2.0, 1, false);
  EXPECT_EQ(joint.state().pressure1_MPa, 0.0);
}

TEST_F(SimulatedJointTest, DisturbanceTermsByHand) {
  PlantParameters plant = ideal_plant();
  plant.initial_angle_rad = 0.5;
  plant.initial_velocity_rad_s = 0.25;
  plant.disturbance = {{DisturbanceKind::kStep, 1.0, 0.0, 1.0},
                       {DisturbanceKind::kPulse, 10.0, 0.0, 1.0, 2.0},
                       {DisturbanceKind::kSine, 100.0, 0.25},
                       {DisturbanceKind::kSineOfStateSum, 1000.0},
                       {DisturbanceKind::kCosineOfStateSum, 10000.0}};
  const SimulatedJoint joint(plant, kPeriod_s);
  const double state_terms = 1000.0 * std::sin(0.75) + 10000.0 * std::cos(0.75);
  EXPECT_NEAR(joint.disturbance_rad_s2(0.0), state_terms, 1e-9);
  EXPECT_NEAR(joint.disturbance_rad_s2(1.0), state_terms + 111.0, 1e-9);
  EXPECT_NEAR(joint.disturbance_rad_s2(2.0), state_terms + 1.0, 1e-9);
}

TEST_F(SimulatedJointTest, TheEncoderQuantisesAndCounts) {
  PlantParameters plant = ideal_plant();
  plant.initial_angle_rad = 0.25;
  SimulatedJoint joint(plant, kPeriod_s);
  control::EncoderCodec codec(config_.encoder);
  for (int k = 0; k < 20; ++k) {
    const control::Frame frame = joint.encoder_frame(config_.encoder);
    const control::EncoderSample sample = codec.decode(&frame);
    EXPECT_EQ(sample.verdict, control::SampleVerdict::kValid);
    EXPECT_EQ(sample.missed_frames, 0u);
    EXPECT_NEAR(sample.angle_rad, 5215.0 * 2.0 * 3.14159265358979 / 131072.0, 1e-12);
  }
}

TEST_F(SimulatedJointTest, EqualSeedsGiveEqualNoise) {
  PlantParameters plant = ideal_plant();
  plant.encoder_noise_rad = 0.01;
  SimulatedJoint first(plant, kPeriod_s);
  SimulatedJoint second(plant, kPeriod_s);
  plant.seed = 2;
  SimulatedJoint third(plant, kPeriod_s);
  const auto data = first.encoder_frame(config_.encoder).data;
  EXPECT_EQ(data, second.encoder_frame(config_.encoder).data);
  EXPECT_NE(data, third.encoder_frame(config_.encoder).data);
}

}  // namespace
}  // namespace eampc::law_design
