#include "control/frame_codec.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace eampc::control {
namespace {

SignalLayout intel(int start, int length, bool is_signed, double factor = 1.0,
                   double offset = 0.0) {
  return {true, start, length, true, is_signed, factor, offset};
}

SignalLayout motorola(int start, int length, bool is_signed, double factor = 1.0,
                      double offset = 0.0) {
  return {true, start, length, false, is_signed, factor, offset};
}

// 0x1A2B5C with bytes 5C 2B 1A: little-endian from bit 0.
TEST(FrameCodec, IntelBytesByHand) {
  FrameData data{};
  insert_bits(data, intel(0, 24, false), 0x1A2B5C);
  EXPECT_EQ(data, (FrameData{0x5C, 0x2B, 0x1A}));
  EXPECT_EQ(extract_bits(data, intel(0, 24, false)), 0x1A2B5Cu);
  EXPECT_EQ(extract_bits(data, intel(4, 8, false)), 0xB5u);
}

// A Motorola signal from bit 7 fills the bytes in reading order; from bit 3 it starts in the low
// nibble.
TEST(FrameCodec, MotorolaBytesByHand) {
  FrameData data{};
  insert_bits(data, motorola(7, 16, false), 0x1A2B);
  EXPECT_EQ(data, (FrameData{0x1A, 0x2B}));
  data = {};
  insert_bits(data, motorola(3, 12, false), 0xABC);
  EXPECT_EQ(data, (FrameData{0x0A, 0xBC}));
  EXPECT_EQ(extract_bits(data, motorola(3, 12, false)), 0xABCu);
}

TEST(FrameCodec, OtherBitsStayAsTheyAre) {
  FrameData data;
  data.fill(0xFF);
  insert_bits(data, intel(10, 5, false), 0);
  EXPECT_EQ(data[1], 0x83);
  EXPECT_EQ(data[0], 0xFF);
}

TEST(FrameCodec, NegativeNumbersAreSignExtended) {
  EXPECT_EQ(nearest_raw(intel(0, 24, true), -1.0), 0xFFFFFFu);
  EXPECT_DOUBLE_EQ(physical_of_raw(intel(0, 24, true), 0x800000), -8388608.0);
  EXPECT_DOUBLE_EQ(physical_of_raw(intel(0, 64, true), ~std::uint64_t{0}), -1.0);
}

TEST(FrameCodec, RoundsToNearestHalfToEven) {
  const SignalLayout volts = intel(0, 16, true, 0.5);
  EXPECT_EQ(nearest_raw(volts, 0.25), 0u);  // 0.5 counts
  EXPECT_EQ(nearest_raw(volts, 0.75), 2u);  // 1.5 counts
  EXPECT_EQ(nearest_raw(volts, 0.74), 1u);
  EXPECT_EQ(nearest_raw(volts, -0.75), 0xFFFEu);
}

TEST(FrameCodec, SaturatesAtTheRawRange) {
  EXPECT_EQ(nearest_raw(intel(0, 16, true), 1e9), 0x7FFFu);
  EXPECT_EQ(nearest_raw(intel(0, 16, true), -1e9), 0x8000u);
  EXPECT_EQ(nearest_raw(intel(0, 12, false), 5000.0), 0xFFFu);
  EXPECT_EQ(nearest_raw(intel(0, 12, false), -3.0), 0u);
  EXPECT_EQ(nearest_raw(intel(0, 64, false), 1e30), ~std::uint64_t{0});
  EXPECT_EQ(nearest_raw(intel(0, 64, true), 1e30), 0x7FFFFFFFFFFFFFFFu);
  EXPECT_EQ(nearest_raw(intel(0, 64, true), -1e30), 0x8000000000000000u);
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(nearest_raw(intel(0, 8, true), infinity), 0x7Fu);
  EXPECT_EQ(nearest_raw(intel(0, 8, true), -infinity), 0x80u);
  EXPECT_EQ(nearest_raw(intel(0, 8, true), std::nan("")), 0u);
}

TEST(FrameCodec, FitsKnowsTheEndOfTheFrame) {
  EXPECT_TRUE(fits(intel(40, 24, false), 8));
  EXPECT_FALSE(fits(intel(41, 24, false), 8));
  EXPECT_FALSE(fits(intel(0, 16, false), 1));
  EXPECT_TRUE(fits(motorola(7, 64, false), 8));
  EXPECT_FALSE(fits(motorola(6, 64, false), 8));
  EXPECT_FALSE(fits(intel(-1, 4, false), 8));
  EXPECT_FALSE(fits(intel(0, 0, false), 8));
}

TEST(FrameCodec, OccupiedBitsByHand) {
  EXPECT_EQ(occupied_bits(intel(4, 8, false)), 0xFF0u);
  EXPECT_EQ(occupied_bits(motorola(3, 12, false)), 0xFF0Fu);
}

// The catalogue's check value of CRC-8/SAE-J1850 over "123456789" is 0x4B: here data id "12", bytes
// "3456789".
TEST(FrameCodec, CrcHasTheCataloguesCheckValue) {
  const FrameData data{'3', '4', '5', '6', '7', '8', '9', 0x00};
  EXPECT_EQ(frame_crc(data, 8, {true, 7, static_cast<std::uint16_t>('1' | ('2' << 8))}), 0x4B);
}

TEST(FrameCodec, EveryBitFlipChangesTheCrc) {
  const CrcLayout layout{true, 7, 0x181};
  const FrameData data{1, 2, 3, 4, 5, 6, 7, 0};
  const std::uint8_t crc = frame_crc(data, 8, layout);
  for (int bit = 0; bit < 56; ++bit) {
    FrameData flipped = data;
    flipped[static_cast<std::size_t>(bit / 8)] ^= static_cast<std::uint8_t>(1 << (bit % 8));
    EXPECT_NE(frame_crc(flipped, 8, layout), crc) << "bit " << bit;
  }
}

TEST(FrameCodec, RandomSignalsComeBackUnchanged) {
  constexpr int kCases = 20'000;
  std::mt19937_64 random(20240601);
  int tried = 0;
  while (tried < kCases) {
    SignalLayout layout;
    layout.present = true;
    layout.start_bit = static_cast<int>(random() % 64);
    layout.length = 1 + static_cast<int>(random() % 64);
    layout.little_endian = random() % 2 == 0;
    if (!fits(layout, 8)) continue;
    ++tried;
    const std::uint64_t mask =
        layout.length == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << layout.length) - 1;
    const std::uint64_t raw = random() & mask;
    FrameData data;
    for (auto& byte : data) byte = static_cast<std::uint8_t>(random());
    const FrameData before = data;
    insert_bits(data, layout, raw);
    ASSERT_EQ(extract_bits(data, layout), raw);
    const std::uint64_t bits = occupied_bits(layout);
    for (std::size_t byte = 0; byte < 8; ++byte) {
      const auto own = static_cast<std::uint8_t>(bits >> (8 * byte));
      ASSERT_EQ(data[byte] & ~own, before[byte] & ~own);
    }
  }
}

}  // namespace
}  // namespace eampc::control
