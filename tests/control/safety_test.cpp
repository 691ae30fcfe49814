#include "control/safety.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>

#include "control/reference_joint.hpp"

namespace eampc::control {
namespace {

constexpr auto kNone = OperatorAction::kNone;
constexpr auto kArm = OperatorAction::kArm;
constexpr auto kDisarm = OperatorAction::kDisarm;
constexpr auto kReset = OperatorAction::kReset;

// Ramps of ten periods instead of a hundred, time-out of four.
class SafetyTest : public testing::Test {
 protected:
  SafetyTest() {
    joint_.config.safety.arming_ramp_s = 0.05;
    joint_.config.safety.soft_stop_ramp_s = 0.05;
    joint_.config.safety.encoder_invalid_frames = 100;  // the time-out comes first
    rebuild();
  }

  void rebuild() { safety_ = std::make_unique<Safety>(joint_.config); }

  // One whole cycle: both halves, what was decided counts as sent.
  SafetyState cycle(OperatorAction action = kNone, SampleVerdict verdict = SampleVerdict::kValid,
                    double u = 0.0, bool send_failed = false) {
    entered_ = advance(verdict, action, send_failed, 1).law_begins;
    LawOutput law;
    law.u = u;
    decision_ = safety_->decide({}, {}, law);
    safety_->sent(decision_.demand.voltages);
    return safety_->state();
  }

  SafetyState advance(SampleVerdict verdict, OperatorAction action, bool send_refused,
                      std::int32_t elapsed_periods) {
    EncoderSample sample;
    sample.verdict = verdict;
    return safety_->advance({{}, bus(send_refused), action, elapsed_periods}, sample);
  }

  static BusHealth bus(bool send_refused) {
    BusHealth health;
    health.queue_proved_empty = true;
    health.send_refused = send_refused;
    return health;
  }

  void cycles(int count) {
    for (int i = 0; i < count; ++i) cycle();
  }

  void go(Mode mode) {
    rebuild();
    if (mode == Mode::kInit) return;
    cycle();
    if (mode == Mode::kDisarmed) return;
    cycle(kArm);
    if (mode == Mode::kArming) return;
    cycles(10);
    if (mode == Mode::kActive) return;
    if (mode == Mode::kSoftStop) {
      cycle(kDisarm);
      return;
    }
    cycle(kNone, SampleVerdict::kValid, std::numeric_limits<double>::quiet_NaN());
    cycles(20);
  }

  double u1() const { return decision_.demand.voltages.u1_V; }
  double u2() const { return decision_.demand.voltages.u2_V; }
  bool enabled() const { return decision_.demand.voltages.enable; }

  ReferenceJoint joint_ = reference_joint();
  std::unique_ptr<Safety> safety_;
  SafetyDecision decision_;
  bool entered_ = false;
};

// Every mode against every edge, a valid sample each cycle: what the operator can do, and that he
// can do no more.
TEST_F(SafetyTest, TableOfModesAndEdges) {
  struct Row {
    Mode from;
    OperatorAction action;
    Mode to;
  };
  const Row rows[] = {
      {Mode::kInit, kNone, Mode::kDisarmed},       {Mode::kInit, kArm, Mode::kArming},
      {Mode::kInit, kDisarm, Mode::kDisarmed},     {Mode::kInit, kReset, Mode::kDisarmed},
      {Mode::kDisarmed, kNone, Mode::kDisarmed},   {Mode::kDisarmed, kArm, Mode::kArming},
      {Mode::kDisarmed, kDisarm, Mode::kDisarmed}, {Mode::kDisarmed, kReset, Mode::kDisarmed},
      {Mode::kArming, kNone, Mode::kArming},       {Mode::kArming, kArm, Mode::kArming},
      {Mode::kArming, kDisarm, Mode::kSoftStop},   {Mode::kArming, kReset, Mode::kArming},
      {Mode::kActive, kNone, Mode::kActive},       {Mode::kActive, kArm, Mode::kActive},
      {Mode::kActive, kDisarm, Mode::kSoftStop},   {Mode::kActive, kReset, Mode::kActive},
      {Mode::kSoftStop, kNone, Mode::kSoftStop},   {Mode::kSoftStop, kArm, Mode::kSoftStop},
      {Mode::kSoftStop, kDisarm, Mode::kSoftStop}, {Mode::kSoftStop, kReset, Mode::kSoftStop},
      {Mode::kFault, kNone, Mode::kFault},         {Mode::kFault, kArm, Mode::kFault},
      {Mode::kFault, kDisarm, Mode::kFault},       {Mode::kFault, kReset, Mode::kDisarmed},
  };
  for (const Row& row : rows) {
    go(row.from);
    ASSERT_EQ(safety_->state().mode, row.from);
    EXPECT_EQ(cycle(row.action).mode, row.to)
        << mode_text(row.from) << " with action " << static_cast<int>(row.action);
  }
}

TEST_F(SafetyTest, InitWaitsForTheFirstValidSample) {
  EXPECT_EQ(cycle(kArm, SampleVerdict::kMissing).mode, Mode::kInit);
  EXPECT_EQ(cycle(kArm, SampleVerdict::kBadCrc).mode, Mode::kInit);
  EXPECT_FALSE(enabled());
  EXPECT_EQ(cycle().mode, Mode::kDisarmed);
}

TEST_F(SafetyTest, ArmingTakesExactlyItsRampAndEndsAtTheBias) {
  cycle();
  for (int i = 1; i <= 10; ++i) {
    EXPECT_EQ(cycle(i == 1 ? kArm : kNone).mode, Mode::kArming);
    EXPECT_LT(safety_->state().scenario_time_s, 0.0);
    EXPECT_NEAR(u1(), 0.5 * i, 1e-12);
    EXPECT_EQ(u1(), u2());
    EXPECT_TRUE(enabled());
  }
  EXPECT_EQ(cycle().mode, Mode::kActive);
  EXPECT_TRUE(entered_);
  EXPECT_EQ(safety_->state().scenario_time_s, 0.0);
  cycle();
  EXPECT_FALSE(entered_);
  EXPECT_DOUBLE_EQ(safety_->state().scenario_time_s, 0.005);
}

TEST_F(SafetyTest, WithoutARampArmIsActiveInItsOwnCycle) {
  joint_.config.safety.arming_ramp_s = 0.0;
  rebuild();
  cycle();
  EXPECT_EQ(cycle(kArm).mode, Mode::kActive);
  EXPECT_EQ(safety_->state().scenario_time_s, 0.0);
}

TEST_F(SafetyTest, ArmNeedsAFreshSample) {
  cycle();
  for (int i = 0; i < 4; ++i) cycle(kNone, SampleVerdict::kMissing);
  EXPECT_EQ(cycle(kArm, SampleVerdict::kMissing).mode, Mode::kDisarmed);
  EXPECT_EQ(safety_->state().refusal, Refusal::kCausePresent);
  EXPECT_EQ(safety_->state().refusal_cause, Fault::kEncoderTimeout);
  EXPECT_EQ(cycle(kArm).mode, Mode::kDisarmed);  // the frame that ends the silence
  EXPECT_EQ(cycle(kArm).mode, Mode::kArming);
  EXPECT_EQ(safety_->state().refusal, Refusal::kNone);
}

TEST_F(SafetyTest, ArmIsRefusedWhileTheBusRefusesFrames) {
  cycle();
  EXPECT_EQ(cycle(kArm, SampleVerdict::kValid, 0.0, true).mode, Mode::kDisarmed);
}

TEST_F(SafetyTest, TheLawsVoltages) {
  go(Mode::kActive);
  cycle(kNone, SampleVerdict::kValid, 4.0);
  EXPECT_NEAR(u1(), 6.8, 1e-12);
  EXPECT_NEAR(u2(), 3.2, 1e-12);
  EXPECT_EQ(decision_.limits, kLimitNone);
}

TEST_F(SafetyTest, DisarmRampsToTheBiasThenToTheSafeVoltage) {
  go(Mode::kActive);
  cycle(kNone, SampleVerdict::kValid, 4.0);
  for (int i = 1; i <= 10; ++i) {
    EXPECT_EQ(cycle(i == 1 ? kDisarm : kNone).mode, Mode::kSoftStop);
    EXPECT_NEAR(u1(), 6.8 - 0.18 * i, 1e-12);
    EXPECT_NEAR(u2(), 3.2 + 0.18 * i, 1e-12);
  }
  for (int i = 1; i <= 10; ++i) {
    EXPECT_EQ(cycle().mode, Mode::kSoftStop);
    EXPECT_NEAR(u1(), 5.0 - 0.5 * i, 1e-12);
    EXPECT_EQ(u1(), u2());
    EXPECT_TRUE(enabled());
  }
  EXPECT_EQ(cycle().mode, Mode::kDisarmed);
  EXPECT_FALSE(enabled());
  EXPECT_EQ(u1(), 0.0);
}

TEST_F(SafetyTest, DisarmWhileArmingOnlyVents) {
  go(Mode::kArming);
  cycle();
  const double top = u1();
  double last = top;
  while (cycle(kDisarm).mode == Mode::kSoftStop) {
    EXPECT_LE(u1(), last);
    EXPECT_EQ(u1(), u2());
    last = u1();
  }
  EXPECT_EQ(safety_->state().mode, Mode::kDisarmed);
}

// Cause and what the operator configured → where the machine goes at once.
TEST_F(SafetyTest, TableOfEncoderFaults) {
  struct Row {
    SampleVerdict verdict;
    Fault fault;
  };
  for (const Row& row : {Row{SampleVerdict::kMissing, Fault::kEncoderTimeout},
                         Row{SampleVerdict::kBadCrc, Fault::kEncoderCrc},
                         Row{SampleVerdict::kWrongLength, Fault::kEncoderLength},
                         Row{SampleVerdict::kDuplicate, Fault::kEncoderFrozen},
                         Row{SampleVerdict::kOutOfRange, Fault::kEncoderOutOfRange}}) {
    for (const StopAction action : {StopAction::kSaturate, StopAction::kSoftStop,
                                    StopAction::kVentRamp, StopAction::kImmediate}) {
      joint_.config.safety.actions[row.fault] = action;
      go(Mode::kActive);
      cycle(kNone, SampleVerdict::kValid, 4.0);
      for (int i = 0; i < 3; ++i) {
        EXPECT_EQ(cycle(kNone, row.verdict, 4.0).mode, Mode::kActive);
      }
      const SafetyState state = cycle(kNone, row.verdict, 4.0);
      EXPECT_EQ(state.fault, row.fault);
      EXPECT_EQ(state.mode, action == StopAction::kImmediate ? Mode::kFault : Mode::kSoftStop);
      switch (action) {
        case StopAction::kSaturate:
          EXPECT_NEAR(u1(), 6.8, 1e-12);
          break;
        case StopAction::kSoftStop:
          EXPECT_NEAR(u1(), 6.8 - 0.18, 1e-12);
          break;
        case StopAction::kVentRamp:
          EXPECT_NEAR(u1(), 6.8 - 0.68, 1e-12);
          break;
        case StopAction::kImmediate:
          EXPECT_EQ(u1(), 0.0);
          break;
      }
      EXPECT_EQ(enabled(), action != StopAction::kImmediate);
      // Good frames again: the stop goes on all the same and ends latched.
      cycles(40);
      EXPECT_EQ(safety_->state().mode, Mode::kFault);
      EXPECT_EQ(safety_->state().fault, row.fault);
      EXPECT_EQ(u1(), 0.0);
      EXPECT_FALSE(enabled());
      EXPECT_EQ(cycle(kReset).fault, Fault::kNone);
      EXPECT_EQ(safety_->state().mode, Mode::kDisarmed);
    }
  }
}

TEST_F(SafetyTest, AValidFrameRestartsTheTimeOut) {
  go(Mode::kActive);
  for (int round = 0; round < 5; ++round) {
    for (int i = 0; i < 3; ++i) cycle(kNone, SampleVerdict::kMissing);
    EXPECT_EQ(cycle().mode, Mode::kActive);
  }
}

// Where no empty period was reported (lock-step, a loop that slept), the counter is the only
// witness.
TEST_F(SafetyTest, ACounterGapAsLongAsTheTimeOutIsASilence) {
  for (const int lost : {3, 4}) {
    go(Mode::kActive);
    advance(SampleVerdict::kValid, kNone, false, 1 + lost);
    EXPECT_EQ(safety_->state().mode, lost < 4 ? Mode::kActive : Mode::kSoftStop);
    EXPECT_EQ(safety_->state().fault, lost < 4 ? Fault::kNone : Fault::kEncoderTimeout);
  }
  go(Mode::kActive);
  cycle(kNone, SampleVerdict::kMissing);
  advance(SampleVerdict::kValid, kNone, false, 4);  // one empty period and three more
  EXPECT_EQ(safety_->state().fault, Fault::kEncoderTimeout);
  go(Mode::kDisarmed);
  advance(SampleVerdict::kValid, kNone, false, 15);
  EXPECT_EQ(safety_->state().fault, Fault::kNone);
}

TEST_F(SafetyTest, SilenceWhileDisarmedIsNoFault) {
  go(Mode::kDisarmed);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(cycle(kNone, SampleVerdict::kMissing).fault, Fault::kNone);
  }
}

TEST_F(SafetyTest, NotFiniteIsStoppedInItsOwnCycle) {
  for (const double broken :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    go(Mode::kActive);
    cycle(kNone, SampleVerdict::kValid, 2.0);
    const SafetyState state = cycle(kNone, SampleVerdict::kValid, broken);
    EXPECT_EQ(state.fault, Fault::kNotFinite);
    EXPECT_EQ(state.mode, Mode::kSoftStop);
    EXPECT_NEAR(u1(), 5.9 - 0.09, 1e-12);
  }
}

TEST_F(SafetyTest, ANotFiniteEstimateIsAFaultEvenWithAFiniteLaw) {
  go(Mode::kActive);
  advance(SampleVerdict::kValid, kNone, false, 1);
  StateEstimate state;
  state.x[1] = std::numeric_limits<double>::quiet_NaN();
  safety_->decide(state, {}, {});
  EXPECT_EQ(safety_->state().fault, Fault::kNotFinite);
}

TEST_F(SafetyTest, TwoRefusedFramesInARowStopAtOnce) {
  go(Mode::kActive);
  EXPECT_EQ(cycle(kNone, SampleVerdict::kValid, 0.0, true).mode, Mode::kActive);
  EXPECT_EQ(cycle().mode, Mode::kActive);
  cycle(kNone, SampleVerdict::kValid, 0.0, true);
  const SafetyState state = cycle(kNone, SampleVerdict::kValid, 0.0, true);
  EXPECT_EQ(state.mode, Mode::kFault);
  EXPECT_EQ(state.fault, Fault::kSendRefused);
  EXPECT_EQ(u1(), 0.0);
}

// The ramp of another fault must not go on once the bus refuses frames: what gets through again
// would raise the pressure in a node that has vented.
TEST_F(SafetyTest, ARefusingBusEndsTheSoftStopOfAnotherFault) {
  go(Mode::kActive);
  for (int i = 0; i < 4; ++i) cycle(kNone, SampleVerdict::kMissing);
  ASSERT_EQ(safety_->state().mode, Mode::kSoftStop);
  ASSERT_EQ(safety_->state().fault, Fault::kEncoderTimeout);
  cycle(kNone, SampleVerdict::kMissing, 0.0, true);
  const SafetyState state = cycle(kNone, SampleVerdict::kMissing, 0.0, true);
  EXPECT_EQ(state.mode, Mode::kFault);
  EXPECT_EQ(state.fault, Fault::kEncoderTimeout);  // the first cause stands
  EXPECT_EQ(u1(), 0.0);
  EXPECT_FALSE(enabled());
}

TEST_F(SafetyTest, BoxAndSlewAreClampedAndReported) {
  joint_.config.valve.slew_max_V_per_s = 100.0;  // 0.5 V per period
  go(Mode::kActive);
  cycle(kNone, SampleVerdict::kValid, 4.0);
  EXPECT_NEAR(u1(), 5.5, 1e-12);
  EXPECT_NEAR(u2(), 4.5, 1e-12);
  EXPECT_TRUE(decision_.limits & kLimitSlewRate);
  joint_.config.valve.slew_max_V_per_s = 4000.0;
  cycle(kNone, SampleVerdict::kValid, 20.0);
  EXPECT_EQ(u1(), 10.0);
  EXPECT_EQ(u2(), 0.0);
  EXPECT_TRUE(decision_.limits & kLimitControlRange);
}

TEST_F(SafetyTest, ARepeatedFrameGivesNoSecondSlewStep) {
  joint_.config.valve.slew_max_V_per_s = 100.0;  // 0.5 V per period
  go(Mode::kActive);
  cycle(kNone, SampleVerdict::kValid, 4.0);
  ASSERT_NEAR(u1(), 5.5, 1e-12);
  advance(SampleVerdict::kDuplicate, kNone, false, 0);
  LawOutput law;
  law.u = 4.0;
  decision_ = safety_->decide({}, {}, law);
  EXPECT_NEAR(u1(), 5.5, 1e-12);
  EXPECT_NEAR(u2(), 4.5, 1e-12);
}

TEST_F(SafetyTest, LimitsOfTheLawArePublished) {
  go(Mode::kActive);
  advance(SampleVerdict::kValid, kNone, false, 1);
  LawOutput law;
  law.parameter_clamped = true;
  law.at_range_end = true;
  EXPECT_EQ(safety_->decide({}, {}, law).limits, kLimitControlRange | kLimitParameterBox);
}

TEST_F(SafetyTest, LostFramesCountAsPeriods) {
  go(Mode::kActive);
  advance(SampleVerdict::kValid, kNone, false, 3);
  EXPECT_DOUBLE_EQ(safety_->state().scenario_time_s, 0.015);
}

// A million cycles of anything: voltages stay in the box and the slew limit, up only by an arm,
// faults stay latched.
TEST_F(SafetyTest, RandomizedInvariants) {
  constexpr int kCycles = 1'000'000;
  joint_.config.valve.slew_max_V_per_s = 300.0;
  joint_.config.safety.actions[Fault::kEncoderTimeout] = StopAction::kSaturate;
  joint_.config.safety.actions[Fault::kEncoderCrc] = StopAction::kVentRamp;
  rebuild();
  std::mt19937_64 random(99);
  std::normal_distribution<double> control(0.0, 15.0);
  ValveVoltages last{};
  SafetyState before = safety_->state();
  int active = 0;
  for (int i = 0; i < kCycles; ++i) {
    const auto dice = random() % 1000;
    const OperatorAction action = dice < 60   ? kArm
                                  : dice < 64 ? kDisarm
                                  : dice < 90 ? kReset
                                              : kNone;
    const SampleVerdict verdict =
        random() % 5 != 0 ? SampleVerdict::kValid : static_cast<SampleVerdict>(random() % 6);
    const double u =
        random() % 2000 == 0 ? std::numeric_limits<double>::quiet_NaN() : control(random);
    const SafetyState now = cycle(action, verdict, u, random() % 50 == 0);
    active += now.mode == Mode::kActive;
    const ValveVoltages& v = decision_.demand.voltages;
    ASSERT_TRUE(v.u1_V >= 0.0 && v.u1_V <= 10.0 && v.u2_V >= 0.0 && v.u2_V <= 10.0);
    if (v.enable) {
      ASSERT_LE(std::abs(v.u1_V - last.u1_V), 1.5 + 1e-12);
      ASSERT_LE(std::abs(v.u2_V - last.u2_V), 1.5 + 1e-12);
    } else {
      ASSERT_TRUE(v.u1_V == 0.0 && v.u2_V == 0.0);
    }
    if (now.mode == Mode::kArming && before.mode != Mode::kArming) {
      ASSERT_EQ(action, kArm);
    }
    if (before.mode == Mode::kFault && now.mode != Mode::kFault) {
      ASSERT_EQ(action, kReset);
    }
    if (before.fault != Fault::kNone && now.fault != before.fault) {
      ASSERT_EQ(action, kReset);
    }
    last = v;
    before = now;
  }
  EXPECT_GT(active, kCycles / 100);
}

}  // namespace
}  // namespace eampc::control
