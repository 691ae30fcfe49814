// Causes that depend on what the joint is doing, seen through the control cycle.
#include "control/fault_detection.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "control/control_cycle.hpp"
#include "control/encoder_codec.hpp"
#include "control/reference_joint.hpp"

namespace eampc::control {
namespace {

ReferenceJoint joint_with_short_ramps() {
  ReferenceJoint joint = reference_joint();
  connect(joint);
  joint.config.safety.arming_ramp_s = 0.05;
  joint.config.safety.soft_stop_ramp_s = 0.05;
  joint.config.safety.encoder_frozen_s = 0.1;
  joint.config.safety.encoder_frozen_command_V = 0.5;
  joint.config.safety.tx_unconfirmed_periods = 3;
  return joint;
}

// The same angle in every frame.
class FaultDetectionTest : public testing::Test {
 protected:
  CycleRecord step(OperatorAction action = OperatorAction::kNone, bool proved = true) {
    const Frame frame = encode_encoder_frame(joint_.config.encoder, 0.2, 0.0, counter_++, 1);
    CycleInput input;
    input.encoder_frame = &frame;
    input.action = action;
    input.bus.queue_proved_empty = proved;
    return cycle_.step(input).record;
  }

  CycleRecord steps(int count) {
    CycleRecord record;
    for (int k = 0; k < count; ++k) record = step();
    return record;
  }

  ReferenceJoint joint_ = joint_with_short_ramps();
  ControlCycle cycle_{joint_.config};
  std::uint64_t counter_ = 0;
};

// The monitor lets nothing enabled out of an unproved queue: no ACTIVE without commands and fault.
TEST_F(FaultDetectionTest, AMovingJointWhoseQueueIsNotProvedEmptyIsStopped) {
  step();
  step(OperatorAction::kArm);
  ASSERT_EQ(steps(12).mode, Mode::kActive);
  for (int round = 0; round < 3; ++round) {
    EXPECT_EQ(step(OperatorAction::kNone, false).mode, Mode::kActive);
    EXPECT_EQ(step(OperatorAction::kNone, false).mode, Mode::kActive);
    EXPECT_EQ(step().mode, Mode::kActive);
  }
  step(OperatorAction::kNone, false);
  step(OperatorAction::kNone, false);
  const CycleRecord record = step(OperatorAction::kNone, false);
  EXPECT_EQ(record.fault, Fault::kTxUnconfirmed);
  EXPECT_EQ(record.mode, Mode::kFault);
  EXPECT_FALSE(record.valves.enable);
}

TEST_F(FaultDetectionTest, AtRestAnUnprovedQueueIsNoFault) {
  for (int k = 0; k < 100; ++k) {
    ASSERT_TRUE(step(OperatorAction::kNone, false).present_faults.empty());
  }
  EXPECT_EQ(step(OperatorAction::kArm, false).refusal, Refusal::kQueueNotProvedEmpty);
  EXPECT_EQ(step(OperatorAction::kArm).mode, Mode::kArming);
}

// Held by hand, against a command of more than 0.5 V, with an encoder that has no noise.
TEST_F(FaultDetectionTest, AJointHeldStillMayBeDisarmedAndArmedAgain) {
  step();
  step(OperatorAction::kArm);
  CycleRecord record = steps(15);
  ASSERT_EQ(record.mode, Mode::kActive);
  ASSERT_GT(std::abs(record.valves.u1_V - record.valves.u2_V), 1.0);
  step(OperatorAction::kDisarm);
  for (int k = 0; k < 400; ++k) ASSERT_TRUE(step().present_faults.empty()) << k;
  record = step(OperatorAction::kArm);
  EXPECT_EQ(record.mode, Mode::kArming);
  EXPECT_EQ(record.refusal, Refusal::kNone);
}

// Lost frames may end the ramp and tell of the silence in one cycle, the valves still far below.
TEST_F(FaultDetectionTest, AStopAfterASilenceOnTheArmingRampOnlyVents) {
  for (const StopAction action : {StopAction::kSaturate, StopAction::kSoftStop}) {
    joint_.config.safety.actions[Fault::kEncoderTimeout] = action;
    step();
    step(OperatorAction::kArm);
    ValveVoltages last = step().valves;
    ASSERT_LT(last.u1_V, 1.1);
    counter_ += 12;
    CycleRecord record = step();
    ASSERT_EQ(record.fault, Fault::kEncoderTimeout);
    for (int k = 0; k < 40; ++k) {
      ASSERT_LE(record.valves.u1_V, last.u1_V);
      ASSERT_LE(record.valves.u2_V, last.u2_V);
      last = record.valves;
      record = step();
    }
    EXPECT_EQ(record.mode, Mode::kFault);
    ASSERT_EQ(step(OperatorAction::kReset).mode, Mode::kDisarmed);
  }
}

}  // namespace
}  // namespace eampc::control
