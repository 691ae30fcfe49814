// Every fault of the matrix in every mode with each of the four actions: detected in time, acted on
// as configured, latched, never resumed by itself, armed again after a reset. Every frame on the
// way is checked by MatrixBench.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <string>
#include <vector>

#include "control/matrix_bench.hpp"

namespace eampc::control {
namespace {

constexpr StopAction kActions[] = {StopAction::kSaturate, StopAction::kSoftStop,
                                   StopAction::kVentRamp, StopAction::kImmediate};

struct Start {
  Mode mode;
  bool reduced = false;
};
constexpr Start kStarts[] = {{Mode::kInit},         {Mode::kDisarmed}, {Mode::kArming},
                             {Mode::kArming, true}, {Mode::kActive},   {Mode::kSoftStop},
                             {Mode::kFault}};

std::vector<Fault> all_faults() {
  std::vector<Fault> faults;
  for (std::size_t number = 1; number < kFaultCount; ++number) {
    faults.push_back(static_cast<Fault>(number));
  }
  return faults;
}

// A law that answers NaN can only be seen while it is asked.
bool can_happen(Fault fault, const Start& start) {
  return fault != Fault::kNotFinite || start.mode == Mode::kActive || start.reduced;
}

class FaultMatrixTest : public testing::TestWithParam<Fault> {
 protected:
  // What the matrix covered, for who reads the test's output.
  static void TearDownTestSuite() {
    std::printf(
        "fault matrix: %d combinations in motion, %d frames in the box and the slew limit\n",
        combinations_, frames_);
    for (const Fault fault : all_faults()) {
      std::printf("  %-20s detected within %2d cycles (stated: %2d)\n", fault_name(fault),
                  worst_cycles_[static_cast<std::size_t>(fault)], detection_cycles(fault));
    }
  }

  void TearDown() override { frames_ += bench_.frames_checked(); }

  static inline int combinations_ = 0;
  static inline int frames_ = 0;
  static inline std::array<int, kFaultCount> worst_cycles_{};

  std::string where(const Start& start, StopAction action) const {
    return std::string(fault_name(GetParam())) + " in " + mode_text(start.mode) +
           (start.reduced ? " (reduced)" : "") + " with " + action_name(action);
  }

  MatrixBench bench_;
};

TEST_P(FaultMatrixTest, AtRestNothingMovesAndArmingIsRefused) {
  const Fault fault = GetParam();
  if (fault == Fault::kNotFinite) return;
  for (const StopAction action : kActions) {
    bench_.config().safety.actions[fault] = action;
    for (const Mode mode : {Mode::kInit, Mode::kDisarmed, Mode::kFault}) {
      bench_.go(mode);
      bench_.set_wrong(fault);
      bool seen = false;
      CycleRecord record;
      for (int k = 0; k < detection_cycles(fault); ++k) {
        record = bench_.step();
        seen |= record.present_faults.has(fault);
      }
      // The first frame ever can be compared with nothing.
      const bool needs_a_frame_before = fault == Fault::kEncoderFrozen ||
                                        fault == Fault::kEncoderJump ||
                                        fault == Fault::kEncoderCounterGap;
      EXPECT_TRUE(seen || (needs_a_frame_before && mode == Mode::kInit)) << where({mode}, action);
      EXPECT_TRUE(bench_.at_rest());
      EXPECT_EQ(record.fault, mode == Mode::kFault ? Fault::kBusOff : Fault::kNone);
      // Jump and gap are events: told in one cycle, over in the next.
      const bool holds = record.present_faults.has(fault) && fault != Fault::kEncoderJump &&
                         fault != Fault::kEncoderCounterGap;
      if (mode == Mode::kDisarmed && holds) {
        record = bench_.step(OperatorAction::kArm);
        EXPECT_EQ(record.mode, Mode::kDisarmed) << where({mode}, action);
        EXPECT_EQ(record.refusal, Refusal::kCausePresent);
        EXPECT_TRUE(record.present_faults.has(record.refusal_cause));
      }
      if (mode == Mode::kFault) {
        EXPECT_EQ(bench_.step(OperatorAction::kArm).refusal, Refusal::kFaultLatched);
        EXPECT_TRUE(bench_.at_rest());
      }
    }
  }
}

TEST_P(FaultMatrixTest, InMotionItIsDetectedInTimeActedOnAndLatched) {
  const Fault fault = GetParam();
  for (const StopAction action : kActions) {
    bench_.config().safety.actions[fault] = action;
    for (const Start& start : kStarts) {
      const bool moves = start.mode == Mode::kArming || start.mode == Mode::kActive ||
                         start.mode == Mode::kSoftStop;
      if (!moves || !can_happen(fault, start)) continue;
      SCOPED_TRACE(where(start, action));
      bench_.go(start.mode, start.reduced);
      bench_.set_wrong(fault);
      ValveVoltages before;
      CycleRecord record;
      bool law_acted = start.mode != Mode::kArming || start.reduced;
      int cycles = 0;
      do {
        before = bench_.last();
        law_acted |= record.law.region >= 0;
        record = bench_.step();
        ++cycles;
      } while (record.fault == Fault::kNone && cycles <= detection_cycles(fault));
      ASSERT_LE(cycles, detection_cycles(fault));
      ASSERT_EQ(record.fault, fault);
      ++combinations_;
      int& worst = worst_cycles_[static_cast<std::size_t>(fault)];
      worst = std::max(worst, cycles);

      const ValveVoltages& v = bench_.last();
      if (action == StopAction::kImmediate) {
        EXPECT_EQ(record.mode, Mode::kFault);
      } else {
        EXPECT_EQ(record.mode, Mode::kSoftStop);
      }
      if (start.mode == Mode::kActive) {
        // One tenth of the way per period; the bench's slew limit is wider than that.
        const double to_V = action == StopAction::kSoftStop ? 5.0 : 0.0;
        if (action == StopAction::kSaturate) {
          EXPECT_NEAR(v.u1_V, before.u1_V, 1e-3);
          EXPECT_NEAR(v.u2_V, before.u2_V, 1e-3);
        } else if (action != StopAction::kImmediate) {
          EXPECT_NEAR(v.u1_V, before.u1_V + 0.1 * (to_V - before.u1_V), 1e-3);
          EXPECT_NEAR(v.u2_V, before.u2_V + 0.1 * (to_V - before.u2_V), 1e-3);
        }
      }

      // The cause goes on past the longest stop (a hold, two ramps), then away: latched all along.
      for (int k = 0; k < 60; ++k) {
        if (k == 45) bench_.set_wrong(Fault::kNone);
        if (!law_acted) {  // a stop on the way up only goes down
          ASSERT_LE(bench_.last().u1_V, before.u1_V);
          ASSERT_LE(bench_.last().u2_V, before.u2_V);
          before = bench_.last();
        }
        record = bench_.step();
        ASSERT_EQ(record.fault, fault);
        ASSERT_TRUE(record.mode == Mode::kSoftStop || record.mode == Mode::kFault);
      }
      EXPECT_EQ(record.mode, Mode::kFault);
      EXPECT_TRUE(bench_.at_rest());
      for (int k = 0; k < 250; ++k) {
        record = bench_.step();
        ASSERT_EQ(record.mode, Mode::kFault);
        ASSERT_EQ(record.fault, fault);
      }

      // Up only by reset, then arm.
      record = bench_.step(OperatorAction::kArm);
      EXPECT_EQ(record.mode, Mode::kFault);
      EXPECT_EQ(record.refusal, Refusal::kFaultLatched);
      EXPECT_EQ(record.refusal_cause, fault);
      record = bench_.step(OperatorAction::kReset);
      ASSERT_EQ(record.mode, Mode::kDisarmed);
      ASSERT_EQ(record.fault, Fault::kNone);
      record = bench_.steps(20);
      ASSERT_EQ(record.mode, Mode::kDisarmed);
      ASSERT_EQ(bench_.step(OperatorAction::kArm).mode, Mode::kArming);
      ASSERT_EQ(bench_.steps(30).mode, Mode::kActive);
    }
  }
}

TEST_P(FaultMatrixTest, NoResetWhileTheCausePersists) {
  const Fault fault = GetParam();
  // These are events, told once, or cannot be seen at rest.
  if (fault == Fault::kEncoderJump || fault == Fault::kEncoderCounterGap ||
      fault == Fault::kNotFinite || fault == Fault::kDeadlineOverruns) {
    return;
  }
  bench_.config().safety.actions[fault] = StopAction::kImmediate;
  bench_.go(Mode::kActive);
  bench_.set_wrong(fault);
  CycleRecord record = bench_.steps(detection_cycles(fault));
  ASSERT_EQ(record.mode, Mode::kFault);
  record = bench_.step(OperatorAction::kReset);
  EXPECT_EQ(record.mode, Mode::kFault);
  EXPECT_EQ(record.refusal, Refusal::kCausePresent);
  EXPECT_EQ(record.refusal_cause, fault);
  bench_.set_wrong(Fault::kNone);
  bench_.steps(20);
  EXPECT_EQ(bench_.step(OperatorAction::kReset).mode, Mode::kDisarmed);
}

// What is not wrong for long enough, or not by enough, stops nothing.
TEST_P(FaultMatrixTest, ShorterThanItsThresholdIsNoFault) {
  const Fault fault = GetParam();
  if (detection_cycles(fault) < 2) return;
  // Three periods of silence are no time-out, but a gap of three frames.
  if (fault == Fault::kEncoderTimeout) bench_.config().safety.encoder_counter_gap_max = 3;
  bench_.go(Mode::kActive);
  // The heartbeat comes every five periods: one may fail to come.
  const int cycles = fault == Fault::kHeartbeatLost ? 5 : detection_cycles(fault) - 1;
  for (int round = 0; round < 5; ++round) {
    bench_.set_wrong(fault);
    CycleRecord record = bench_.steps(cycles);
    EXPECT_EQ(record.fault, Fault::kNone) << fault_name(fault);
    bench_.set_wrong(Fault::kNone);
    record = bench_.steps(31);
    EXPECT_EQ(record.mode, Mode::kActive) << fault_name(fault);
    EXPECT_EQ(record.fault, Fault::kNone) << fault_name(fault);
  }
}

INSTANTIATE_TEST_SUITE_P(All, FaultMatrixTest, testing::ValuesIn(all_faults()),
                         [](const auto& tested) { return std::string(fault_name(tested.param)); });

TEST(FaultMatrix, WithoutAFaultNothingHappens) {
  MatrixBench bench;
  bench.go(Mode::kActive);
  for (int k = 0; k < 5000; ++k) {
    const CycleRecord record = bench.step();
    ASSERT_EQ(record.mode, Mode::kActive);
    ASSERT_TRUE(record.present_faults.empty());
  }
}

// A rig that names no monitored message has none of their faults, however long it runs.
TEST(FaultMatrix, WhatIsNotMonitoredIsNoFault) {
  MatrixBench bench;
  ControllerConfig& c = bench.config();
  for (MonitoredLayout* layout :
       {static_cast<MonitoredLayout*>(&c.valve_feedback),
        static_cast<MonitoredLayout*>(&c.heartbeat), static_cast<MonitoredLayout*>(&c.emergency),
        static_cast<MonitoredLayout*>(&c.e_stop), static_cast<MonitoredLayout*>(&c.identity)}) {
    layout->present = false;
  }
  bench.go(Mode::kActive);
  for (const Fault fault : {Fault::kHeartbeatLost, Fault::kEmergencyMessage, Fault::kSupplyPressure,
                            Fault::kEStop, Fault::kLawMismatch}) {
    bench.set_wrong(fault);
    EXPECT_EQ(bench.steps(100).mode, Mode::kActive) << fault_name(fault);
    bench.set_wrong(Fault::kNone);
  }
}

// Ordered pairs of actions: the stronger one cuts in, the weaker one changes nothing, and the first
// cause keeps its name.
TEST(FaultMatrix, AStrongerActionCutsIntoAWeakerStop) {
  for (const StopAction first : kActions) {
    for (const StopAction second : kActions) {
      MatrixBench bench;
      bench.config().safety.actions[Fault::kEncoderStatus] = first;
      bench.config().safety.actions[Fault::kEStop] = second;
      bench.config().safety.soft_stop_ramp_s = 0.5;
      bench.go(Mode::kActive);
      bench.set_wrong(Fault::kEncoderStatus);
      bench.steps(3);
      const ValveVoltages before = bench.last();
      bench.set_wrong(Fault::kEStop);
      const CycleRecord record = bench.step();
      EXPECT_EQ(record.fault, Fault::kEncoderStatus);
      const bool at_once = std::max(first, second) == StopAction::kImmediate;
      EXPECT_EQ(record.mode, at_once ? Mode::kFault : Mode::kSoftStop);
      if (at_once) continue;
      const ValveVoltages later = bench.last();
      const double mean_V = 0.5 * (later.u1_V + later.u2_V);
      switch (std::max(first, second)) {
        case StopAction::kSaturate:
          EXPECT_NEAR(later.u1_V, before.u1_V, 1e-3);
          break;
        case StopAction::kSoftStop:  // both ways meet at the bias
          EXPECT_NEAR(mean_V, 5.0, 0.01);
          EXPECT_NE(later.u1_V, before.u1_V);
          break;
        default:  // both fall
          EXPECT_LT(mean_V, 0.5 * (before.u1_V + before.u2_V) - 0.02);
          break;
      }
      bench.set_wrong(Fault::kNone);
      EXPECT_EQ(bench.steps(400).mode, Mode::kFault);
      EXPECT_EQ(bench.steps(1).fault, Fault::kEncoderStatus);
    }
  }
}

// The soft stop of an operator's disarm that meets a fault ends in FAULT.
TEST(FaultMatrix, AFaultDuringADisarmIsLatched) {
  MatrixBench bench;
  bench.go(Mode::kSoftStop);
  bench.set_wrong(Fault::kEncoderStatus);
  EXPECT_EQ(bench.step().fault, Fault::kEncoderStatus);
  bench.set_wrong(Fault::kNone);
  EXPECT_EQ(bench.steps(40).mode, Mode::kFault);
}

// An alarm and its all-clear in one period: an alarm.
TEST(FaultMatrix, AnAlarmIsNotOverwrittenByItsAllClear) {
  ReferenceJoint joint = monitored_joint();
  MonitorCodec codec(joint.config);
  Frame stop;
  stop.id = 0x10;
  stop.length = 1;
  stop.data[0] = 1;
  codec.observe(stop);
  stop.data[0] = 0;
  codec.observe(stop);
  MonitorSample sample = codec.take();
  EXPECT_TRUE(sample.e_stop);
  EXPECT_TRUE(sample.e_stop_released);
  sample = codec.take();
  EXPECT_FALSE(sample.e_stop);
  EXPECT_FALSE(sample.e_stop_released);
}

TEST(FaultMatrix, AnUnreadableAlarmIsAnAlarmAnUnreadableHeartbeatIsNone) {
  ReferenceJoint joint = monitored_joint();
  MonitorCodec codec(joint.config);
  Frame frame;
  for (const std::uint32_t id : {0x10u, 0x81u, 0x182u, 0x281u, 0x701u}) {
    frame.id = id;
    frame.length = 3;  // of none of them
    codec.observe(frame);
  }
  const MonitorSample sample = codec.take();
  EXPECT_TRUE(sample.e_stop);
  EXPECT_TRUE(sample.emergency);
  EXPECT_FALSE(sample.heartbeat_seen);
  EXPECT_FALSE(sample.feedback_seen);
  EXPECT_FALSE(sample.identity_differs);
}

TEST(FaultMatrix, ANodeThatStartsAnewHasNoEmergencyAnyMore) {
  MatrixBench bench;
  bench.config().safety.actions[Fault::kEmergencyMessage] = StopAction::kImmediate;
  bench.go(Mode::kActive);
  ControlCycle cycle(bench.config());
  Frame emergency;
  emergency.id = 0x81;
  emergency.length = 8;
  emergency.data[1] = 0x10;
  cycle.observe(emergency);
  CycleInput input;
  EXPECT_TRUE(cycle.step(input).record.present_faults.has(Fault::kEmergencyMessage));
  EXPECT_TRUE(cycle.step(input).record.present_faults.has(Fault::kEmergencyMessage));
  Frame boot_up;
  boot_up.id = 0x701;
  boot_up.length = 1;
  cycle.observe(boot_up);
  EXPECT_FALSE(cycle.step(input).record.present_faults.has(Fault::kEmergencyMessage));
}

// A cable cut at the stop button is a button pressed.
TEST(FaultMatrix, ASilentStopButtonIsPressed) {
  ReferenceJoint joint = monitored_joint();
  joint.config.safety.e_stop_timeout_s = 0.1;
  FaultDetection detection(joint.config);
  const auto stopped = [&](bool released) {
    EncoderSample sample;
    MonitorSample monitor;
    monitor.e_stop_released = released;
    return detection.check(sample, monitor, {}, 1, {}, false).has(Fault::kEStop);
  };
  EXPECT_TRUE(stopped(false));  // never heard
  for (int round = 0; round < 3; ++round) {
    EXPECT_FALSE(stopped(true));
    for (int k = 1; k < 20; ++k) EXPECT_FALSE(stopped(false)) << k;
    EXPECT_TRUE(stopped(false));
  }
}

TEST(FaultMatrix, ArmIsRefusedWhileAnOldCommandMayWait) {
  ReferenceJoint joint = monitored_joint();
  joint.config.heartbeat.present = false;
  joint.config.valve_feedback.present = false;
  ControlCycle cycle(joint.config);
  std::uint64_t counter = 0;
  const auto step = [&](OperatorAction action, bool proved, std::int32_t unconfirmed) {
    const Frame frame = encode_encoder_frame(joint.config.encoder, 0.0, 0.0, counter++, 1);
    CycleInput input;
    input.encoder_frame = &frame;
    input.action = action;
    input.bus.queue_proved_empty = proved;
    input.bus.unconfirmed_periods = unconfirmed;
    return cycle.step(input).record;
  };
  EXPECT_EQ(step(OperatorAction::kArm, false, 0).refusal, Refusal::kQueueNotProvedEmpty);
  EXPECT_EQ(step(OperatorAction::kArm, true, 1).refusal, Refusal::kQueueNotProvedEmpty);
  const CycleRecord record = step(OperatorAction::kArm, true, 0);
  EXPECT_EQ(record.mode, Mode::kArming);
  EXPECT_EQ(record.refusal, Refusal::kNone);
  EXPECT_EQ(step(OperatorAction::kArm, true, 0).refusal, Refusal::kAlreadyArmed);
  step(OperatorAction::kDisarm, true, 0);
  EXPECT_EQ(step(OperatorAction::kArm, true, 0).refusal, Refusal::kNotAtRest);
}

TEST(FaultMatrix, TheLawBeginsWithinReducedLimits) {
  MatrixBench bench;
  bench.go(Mode::kDisarmed);
  bench.set_reference(0.9);  // asks for u = 7.2 at rest, 11 on the way
  bench.step(OperatorAction::kArm);
  int reduced = 0;
  CycleRecord record;
  ValveVoltages before = bench.last();
  for (record = bench.step(); record.mode == Mode::kArming; record = bench.step()) {
    EXPECT_LT(record.scenario_time_s, 0.0);
    if ((record.limits & kLimitReduced) != 0) {
      ++reduced;
      // Half of ±5 V around the bias, 100 V/s.
      EXPECT_LE(std::abs(bench.last().u1_V - 5.0), 2.5 + 1e-3);
      EXPECT_LE(std::abs(bench.last().u1_V - before.u1_V), 0.5 + 1e-9);
      EXPECT_EQ(record.reference.velocity_rad_s, 0.0);
      EXPECT_GE(record.law.region, 0);
    }
    before = bench.last();
  }
  EXPECT_EQ(reduced, 10);
  EXPECT_EQ(record.mode, Mode::kActive);
  EXPECT_EQ(record.scenario_time_s, 0.0);
  EXPECT_EQ(record.limits & kLimitReduced, 0u);
  bench.steps(3);
  EXPECT_GT(std::abs(bench.last().u1_V - 5.0), 2.6);
}

}  // namespace
}  // namespace eampc::control
