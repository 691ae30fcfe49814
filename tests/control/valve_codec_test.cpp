#include "control/valve_codec.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "control/frame_codec.hpp"
#include "control/reference_joint.hpp"

namespace eampc::control {
namespace {

constexpr VoltageWindow kWholeRange{0.0, 10.0};

// 7.25 V = 7250 = 0x1C52, 2.75 V = 2750 = 0x0ABE, enable 1, counter 0: bytes by hand, CRC-8 by the
// PyPI package crccheck.
TEST(ValveCodec, GoldenFrame) {
  const ReferenceJoint joint = reference_joint();
  ValveCodec codec(joint.config.valve_command);
  const EncodedCommand command = codec.encode({{7.25, 2.75, true}, kWholeRange, kWholeRange});
  const FrameData expected{0x52, 0x1C, 0xBE, 0x0A, 0x01, 0x00, 0x00, 0x4F};
  EXPECT_EQ(command.frame.data, expected);
  EXPECT_EQ(command.frame.id, 0x201u);
  EXPECT_EQ(command.frame.length, 8);
  EXPECT_DOUBLE_EQ(command.sent.u1_V, 7.25);
}

TEST(ValveCodec, TheCounterCountsCommandsModuloSixteen) {
  const ReferenceJoint joint = reference_joint();
  ValveCodec codec(joint.config.valve_command);
  for (std::uint64_t k = 0; k < 40; ++k) {
    const Frame frame = codec.encode({{5.0, 5.0, true}, kWholeRange, kWholeRange}).frame;
    EXPECT_EQ(extract_bits(frame.data, joint.config.valve_command.counter), k % 16);
  }
}

TEST(ValveCodec, RandomDemandsStayInTheirWindowAfterRounding) {
  constexpr int kCases = 100'000;
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> voltage(0.0, 10.0);
  ReferenceJoint joint = reference_joint();
  for (const double factor : {0.001, -0.001, 10.0 / 4095.0, 0.0125}) {
    joint.config.valve_command.u1.factor = factor;
    ValveCodec codec(joint.config.valve_command);
    for (int i = 0; i < kCases / 4; ++i) {
      const double lower = std::min(voltage(random), 10.0 - std::abs(factor));
      const VoltageWindow window{lower, lower + std::abs(factor) * (1.0 + voltage(random))};
      const double wanted =
          std::uniform_real_distribution<double>(window.lower_V, window.upper_V)(random);
      const double sent = codec.encode({{wanted, 5.0, true}, window, kWholeRange}).sent.u1_V;
      ASSERT_GE(sent, window.lower_V - 1e-9);
      ASSERT_LE(sent, window.upper_V + 1e-9);
      ASSERT_LE(std::abs(sent - wanted), std::abs(factor));
    }
  }
}

TEST(ValveCodec, DecodesItsOwnFramesAndRefusesDamagedOnes) {
  const ReferenceJoint joint = reference_joint();
  ValveCodec codec(joint.config.valve_command);
  Frame frame = codec.encode({{1.234, 8.766, true}, kWholeRange, kWholeRange}).frame;
  ValveVoltages voltages;
  ASSERT_TRUE(decode_valve_frame(joint.config.valve_command, frame, voltages));
  EXPECT_NEAR(voltages.u1_V, 1.234, 1e-12);
  EXPECT_TRUE(voltages.enable);
  frame.data[0] ^= 1;
  EXPECT_FALSE(decode_valve_frame(joint.config.valve_command, frame, voltages));
}

}  // namespace
}  // namespace eampc::control
