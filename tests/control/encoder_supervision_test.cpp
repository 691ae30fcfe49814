#include "control/encoder_supervision.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "control/matrix_bench.hpp"

namespace eampc::control {
namespace {

// Time-out of four periods, frozen after twenty with more than 0.5 V, jump above
// 18 rad/s · 5 ms + 0.05 rad = 0.14 rad per period.
class EncoderSupervisionTest : public testing::Test {
 protected:
  FaultSet see(double angle_rad, double command_V = 0.0, std::int32_t elapsed = 1,
               double velocity_rad_s = 0.0) {
    EncoderSample sample;
    sample.verdict = SampleVerdict::kValid;
    sample.angle_rad = angle_rad;
    sample.velocity_rad_s = velocity_rad_s;
    const FaultSet present =
        supervision_.check(sample, elapsed, {5.0 + command_V, 5.0 - command_V, true}, law_acts_);
    verdict_ = sample.verdict;
    return present;
  }

  FaultSet miss() {
    EncoderSample sample;
    return supervision_.check(sample, 1, {5.0, 5.0, true}, law_acts_);
  }

  ReferenceJoint joint_ = monitored_joint();
  EncoderSupervision supervision_{joint_.config};
  SampleVerdict verdict_ = SampleVerdict::kMissing;
  bool law_acts_ = true;
};

TEST_F(EncoderSupervisionTest, AJointAtRestUnderAConstantCommandIsNotFrozen) {
  see(0.2, 1.5);
  for (int k = 0; k < 10'000; ++k) ASSERT_TRUE(see(0.2, 1.5).empty()) << k;
}

TEST_F(EncoderSupervisionTest, SmallMovesOfTheCommandDoNotMakeItFrozen) {
  for (int k = 0; k < 10'000; ++k) ASSERT_TRUE(see(0.2, k % 2 == 0 ? 0.24 : -0.25).empty()) << k;
}

TEST_F(EncoderSupervisionTest, TheSameBitsThoughTheCommandMovedAreFrozenAfterTwentyPeriods) {
  see(0.2, 0.0);
  for (int k = 0; k < 100; ++k) see(0.2, 0.0);
  for (int k = 1; k < 20; ++k) ASSERT_TRUE(see(0.2, 0.51).empty()) << k;
  EXPECT_TRUE(see(0.2, 0.51).has(Fault::kEncoderFrozen));
  EXPECT_TRUE(see(0.2, 0.0).has(Fault::kEncoderFrozen));  // until the value changes
  EXPECT_FALSE(see(0.2001, 0.0).has(Fault::kEncoderFrozen));
}

TEST_F(EncoderSupervisionTest, AVelocityThatChangesIsNotFrozen) {
  for (int k = 0; k < 200; ++k) ASSERT_TRUE(see(0.2, 0.02 * k, 1, 0.001 * (k % 2)).empty());
}

// A joint that a friction holds, an encoder without noise: in a stop and at rest that is no fault.
TEST_F(EncoderSupervisionTest, WithoutTheLawNothingIsFrozen) {
  see(0.2, 2.0);
  law_acts_ = false;
  for (int k = 0; k < 20; ++k) ASSERT_TRUE(see(0.2, 2.0 - 0.1 * k).empty()) << k;
  for (int k = 0; k < 1000; ++k) ASSERT_TRUE(see(0.2, 0.0).empty()) << k;
  law_acts_ = true;  // judged anew, from the command with which the law began
  for (int k = 0; k < 100; ++k) ASSERT_TRUE(see(0.2, 0.49).empty()) << k;
}

TEST_F(EncoderSupervisionTest, FrozenEndsWithTheLaw) {
  see(0.2, 0.0);
  for (int k = 0; k < 20; ++k) see(0.2, 1.0);
  ASSERT_TRUE(see(0.2, 1.0).has(Fault::kEncoderFrozen));
  law_acts_ = false;
  EXPECT_TRUE(miss().empty());
  EXPECT_TRUE(see(0.2, 0.0).empty());
}

TEST_F(EncoderSupervisionTest, ZeroSwitchesFrozenOff) {
  joint_.config.safety.encoder_frozen_s = 0.0;
  EncoderSupervision off(joint_.config);
  for (int k = 0; k < 1000; ++k) {
    EncoderSample sample;
    sample.verdict = SampleVerdict::kValid;
    ASSERT_TRUE(off.check(sample, 1, {10.0 * (k % 2), 0.0, true}, true).empty());
  }
}

TEST_F(EncoderSupervisionTest, AJumpIsToldOnceAndIsNoSample) {
  see(0.0);
  EXPECT_TRUE(see(0.139).empty());
  EXPECT_EQ(verdict_, SampleVerdict::kValid);
  EXPECT_TRUE(see(0.28).has(Fault::kEncoderJump));
  EXPECT_EQ(verdict_, SampleVerdict::kJump);
  EXPECT_TRUE(see(0.28).empty());
  EXPECT_EQ(verdict_, SampleVerdict::kValid);
}

TEST_F(EncoderSupervisionTest, ALongerWayTakesLonger) {
  see(0.0);
  miss();
  EXPECT_TRUE(see(0.22).empty());  // two periods: 0.23 rad
  miss();
  miss();
  EXPECT_TRUE(see(0.22 + 0.33).has(Fault::kEncoderJump));  // three: 0.32 rad
}

// After a silence as long as the time-out nobody knows where the joint is; the silence is told.
TEST_F(EncoderSupervisionTest, AfterASilenceEveryAngleIsPlausible) {
  see(0.0);
  for (int k = 0; k < 4; ++k) miss();
  const FaultSet present = see(3.0);
  EXPECT_FALSE(present.has(Fault::kEncoderJump));
  EXPECT_TRUE(present.has(Fault::kEncoderTimeout));
  EXPECT_TRUE(see(3.0).empty());
}

TEST_F(EncoderSupervisionTest, TheFirstFrameIsNoJumpAndNoSilence) {
  EXPECT_TRUE(see(9.0, 0.0, 200).empty());
}

TEST_F(EncoderSupervisionTest, AGapAboveItsMaximumIsToldOnce) {
  see(0.0);
  EncoderSample sample;
  sample.verdict = SampleVerdict::kValid;
  sample.missed_frames = 1;
  EXPECT_FALSE(supervision_.check(sample, 1, {}, true).has(Fault::kEncoderCounterGap));
  sample.missed_frames = 2;
  EXPECT_TRUE(supervision_.check(sample, 1, {}, true).has(Fault::kEncoderCounterGap));
  sample.missed_frames = 0;
  EXPECT_TRUE(supervision_.check(sample, 1, {}, true).empty());
}

// The counter runs on behind frames that came, but could not be believed.
TEST_F(EncoderSupervisionTest, FramesThatCameDamagedAreNotLost) {
  see(0.0);
  EncoderSample bad;
  bad.verdict = SampleVerdict::kBadCrc;
  supervision_.check(bad, 1, {}, true);
  supervision_.check(bad, 1, {}, true);
  EncoderSample sample;
  sample.verdict = SampleVerdict::kValid;
  sample.missed_frames = 3;  // two damaged, one lost
  EXPECT_TRUE(supervision_.check(sample, 1, {}, true).empty());
  supervision_.check(bad, 1, {}, true);
  sample.missed_frames = 3;  // one damaged, two lost
  EXPECT_TRUE(supervision_.check(sample, 1, {}, true).has(Fault::kEncoderCounterGap));
}

TEST_F(EncoderSupervisionTest, OnlyBitsOfTheMaskAreAFailure) {
  EncoderSample sample;
  sample.verdict = SampleVerdict::kValid;
  for (std::uint32_t status = 0; status < 16; ++status) {
    sample.status_raw = status;
    EXPECT_EQ(supervision_.check(sample, 1, {}, true).has(Fault::kEncoderStatus),
              (status & 0x6) != 0);
  }
}

// The newest verdict names the cause of a silence.
TEST_F(EncoderSupervisionTest, ASilenceIsNamedAfterWhatCameInstead) {
  EncoderSample bad;
  see(0.0);
  bad.verdict = SampleVerdict::kBadCrc;
  supervision_.check(bad, 1, {}, true);
  miss();
  miss();
  EXPECT_TRUE(miss().has(Fault::kEncoderCrc));
  see(0.0);
  bad.verdict = SampleVerdict::kWrongLength;
  supervision_.check(bad, 1, {}, true);
  supervision_.check(bad, 1, {}, true);
  bad.verdict = SampleVerdict::kOutOfRange;
  const FaultSet present = supervision_.check(bad, 1, {}, true);
  EXPECT_TRUE(present.has(Fault::kEncoderOutOfRange));
  EXPECT_FALSE(present.has(Fault::kEncoderLength));
}

TEST(OverrunWindow, CountsWhatLiesWithinTheWindow) {
  OverrunWindow window(160);
  for (int k = 0; k < 16; ++k) EXPECT_EQ(window.add(10, 1), k + 1);
  EXPECT_EQ(window.add(10, 0), 15);
  EXPECT_EQ(window.add(1, 5), 20);
  EXPECT_EQ(window.add(160, 0), 0);
  EXPECT_EQ(window.add(1'000'000'000, 2), 2);
}

TEST(OverrunWindow, NeverForgetsWithinFifteenSixteenthsOfTheWindow) {
  OverrunWindow window(200);
  window.add(1, 1);
  for (int k = 0; k < 180; ++k) ASSERT_EQ(window.add(1, 0), 1) << k;
  std::int64_t sum = 1;
  for (int k = 180; k < 201; ++k) sum = window.add(1, 0);
  EXPECT_EQ(sum, 0);
}

}  // namespace
}  // namespace eampc::control
