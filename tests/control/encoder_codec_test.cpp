#include "control/encoder_codec.hpp"

#include <gtest/gtest.h>

#include "control/frame_codec.hpp"
#include "control/reference_joint.hpp"

namespace eampc::control {
namespace {

class EncoderCodecTest : public testing::Test {
 protected:
  EncoderCodecTest() { set_reference_frames(config_); }

  Frame frame(std::uint64_t counter, double angle_rad = 0.25, double velocity_rad_s = -1.5) {
    return encode_encoder_frame(config_.encoder, angle_rad, velocity_rad_s, counter, 0);
  }

  SampleVerdict verdict(const Frame& f) { return codec_.decode(&f).verdict; }

  ControllerConfig config_;
  EncoderCodec codec_{config_.encoder};
};

// 0.25 rad = 5215.19 counts → 5215 = 0x145F; −1.5 rad/s = −3000 counts = 0xF448; counter 3, status
// 0. CRC-8/SAE-J1850 over 81 01 5F 14 00 48 F4 03 00, by the PyPI package crccheck: 0xCE.
TEST_F(EncoderCodecTest, GoldenFrame) {
  const Frame f = frame(3);
  const FrameData expected{0x5F, 0x14, 0x00, 0x48, 0xF4, 0x03, 0x00, 0xCE};
  EXPECT_EQ(f.data, expected);
  const EncoderSample sample = codec_.decode(&f);
  EXPECT_EQ(sample.verdict, SampleVerdict::kValid);
  EXPECT_NEAR(sample.angle_rad, 0.25, 2.4e-5);
  EXPECT_DOUBLE_EQ(sample.velocity_rad_s, -1.5);
  EXPECT_TRUE(sample.has_velocity);
  EXPECT_EQ(sample.missed_frames, 0u);
}

TEST_F(EncoderCodecTest, NoFrameOrAnotherIdentifierIsMissing) {
  EXPECT_EQ(codec_.decode(nullptr).verdict, SampleVerdict::kMissing);
  Frame other = frame(0);
  other.id = 0x182;
  EXPECT_EQ(verdict(other), SampleVerdict::kMissing);
  Frame extended = frame(0);
  extended.extended = true;
  EXPECT_EQ(verdict(extended), SampleVerdict::kMissing);
}

TEST_F(EncoderCodecTest, WrongLengthAndRemoteFrames) {
  Frame f = frame(0);
  f.length = 7;
  EXPECT_EQ(verdict(f), SampleVerdict::kWrongLength);
  f.length = 8;
  f.remote = true;
  EXPECT_EQ(verdict(f), SampleVerdict::kWrongLength);
}

TEST_F(EncoderCodecTest, ABadCrcDoesNotMoveTheCounter) {
  EXPECT_EQ(verdict(frame(0)), SampleVerdict::kValid);
  Frame bad = frame(1);
  bad.data[2] ^= 0x10;
  EXPECT_EQ(verdict(bad), SampleVerdict::kBadCrc);
  const Frame next = frame(2);
  const EncoderSample sample = codec_.decode(&next);
  EXPECT_EQ(sample.verdict, SampleVerdict::kValid);
  EXPECT_EQ(sample.missed_frames, 1u);
}

TEST_F(EncoderCodecTest, CounterGapsModuloSixteen) {
  EXPECT_EQ(verdict(frame(14)), SampleVerdict::kValid);
  EXPECT_EQ(verdict(frame(14)), SampleVerdict::kDuplicate);
  const Frame wrapped = frame(17);
  EXPECT_EQ(codec_.decode(&wrapped).missed_frames, 2u);
}

TEST_F(EncoderCodecTest, ValuesOutsideTheDbcRangeAreNotBelieved) {
  config_.encoder.angle.minimum = -12.56;
  config_.encoder.angle.maximum = 12.56;
  EXPECT_EQ(verdict(frame(0, 13.0)), SampleVerdict::kOutOfRange);
  EXPECT_EQ(verdict(frame(1, 12.0)), SampleVerdict::kValid);
}

TEST_F(EncoderCodecTest, PositionOnlyEncoder) {
  config_.encoder.velocity.present = false;
  const Frame f = frame(0);
  const EncoderSample sample = codec_.decode(&f);
  EXPECT_EQ(sample.verdict, SampleVerdict::kValid);
  EXPECT_FALSE(sample.has_velocity);
  EXPECT_EQ(sample.velocity_rad_s, 0.0);
}

TEST_F(EncoderCodecTest, StatusIsPassedOn) {
  const Frame f = encode_encoder_frame(config_.encoder, 0.0, 0.0, 0, 5);
  EXPECT_EQ(codec_.decode(&f).status_raw, 5u);
}

}  // namespace
}  // namespace eampc::control
