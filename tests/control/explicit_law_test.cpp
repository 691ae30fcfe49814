#include "control/explicit_law.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "control/reference_joint.hpp"

namespace eampc::control {
namespace {

class TrackingLawTest : public testing::Test {
 protected:
  TrackingLawTest() { connect(joint_); }
  ReferenceJoint joint_ = reference_joint();
  ExplicitLaw law_{joint_.config};
};

// u_ss = (ÿ − b1 y − b2 ẏ − d)/b = (10 + 309.375·0.1 + 10·0.5 − 7.4625)/38.475 = 1; e = (0.02,
// −0.1, v − 1). u = −40·0.02 − 2·(−0.1) + 1 = 0.4.
TEST_F(TrackingLawTest, ParametersByHand) {
  StateEstimate state;
  state.x = {0.12, 0.4, 3.0};
  DisturbanceEstimate disturbance;
  disturbance.for_law = {0.0, 7.4625};
  const LawOutput output = law_.decide(state, disturbance, {0.1, 0.5, 10.0});
  EXPECT_NEAR(output.u, 0.4, 1e-12);
  EXPECT_EQ(output.region, 0);
  EXPECT_FALSE(output.parameter_clamped);
  EXPECT_FALSE(output.at_range_end);
}

TEST_F(TrackingLawTest, TheValveErrorIsFormedWithTheClampedSteadyControl) {
  joint_.gain = {0.0, 0.0, 1.0, 0.0, 0.0, 0.0};  // u = v − u_ss
  connect(joint_);
  joint_.config.law.lower[3] = -2.0;
  joint_.config.law.upper[3] = 2.0;
  StateEstimate state;
  state.x = {0.0, 0.0, 5.0};
  DisturbanceEstimate disturbance;
  disturbance.for_law = {0.0, -384.75};  // u_ss = 10
  const LawOutput output = law_.decide(state, disturbance, {});
  EXPECT_NEAR(output.u, 3.0, 1e-12);
  EXPECT_TRUE(output.parameter_clamped);
}

TEST_F(TrackingLawTest, AParameterOutsideTheBoxIsClampedNotExtrapolated) {
  joint_.config.law.upper[0] = 0.1;
  StateEstimate state;
  state.x = {0.15, 0.0, 0.0};
  const LawOutput output = law_.decide(state, {}, {});
  EXPECT_NEAR(output.u, -4.0, 1e-12);
  EXPECT_TRUE(output.parameter_clamped);
}

TEST_F(TrackingLawTest, TheControlIsClippedAndTheRangesEndReported) {
  StateEstimate state;
  state.x = {-0.9, 0.0, 0.0};
  const LawOutput output = law_.decide(state, {}, {});
  EXPECT_EQ(output.u, 100.0 / 9.0);
  EXPECT_TRUE(output.at_range_end);
}

TEST_F(TrackingLawTest, NotANumberComesOutAsNotANumber) {
  StateEstimate state;
  state.x = {std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0};
  EXPECT_TRUE(std::isnan(law_.decide(state, {}, {}).u));
}

TEST_F(TrackingLawTest, InfinityIsNotClippedIntoTheRange) {
  joint_.gain[0] = 1e308;
  joint_.offset = 1e308;
  connect(joint_);
  EXPECT_TRUE(std::isinf(law_.at({22.0}).u));
}

TEST(ExplicitLaw, TrackingWithoutValveStateHasFiveParameters) {
  ReferenceJoint joint = reference_joint(false);
  connect(joint);
  const ExplicitLaw law(joint.config);
  StateEstimate state;
  state.x = {0.12, 0.4, 3.0};
  DisturbanceEstimate disturbance;
  disturbance.for_law = {0.0, 7.4625};
  EXPECT_NEAR(law.decide(state, disturbance, {0.1, 0.5, 10.0}).u, 0.4, 1e-12);
}

TEST(ExplicitLaw, PaperReadsStateEstimateAndReference) {
  ReferenceJoint joint = reference_joint(false);
  LawConfig& config = joint.config.law;
  config.formulation = Formulation::kPaper;
  config.reference_is_parameter = true;
  joint.gain = {1.0, 10.0, 100.0, 1000.0, 10000.0};
  joint.offset = 0.5;
  config.u_min = -1e9;
  config.u_max = 1e9;
  connect(joint);
  const ExplicitLaw law(joint.config);
  StateEstimate state;
  state.x = {1.0, 2.0, 0.0};
  DisturbanceEstimate disturbance;
  disturbance.sigma = {9.0, 9.0};
  disturbance.for_law = {3.0, 4.0};
  EXPECT_DOUBLE_EQ(law.decide(state, disturbance, {5.0, 0.0, 0.0}).u, 54321.5);
}

}  // namespace
}  // namespace eampc::control
