#include "control/frame_codec.hpp"

#include <bit>
#include <cmath>

namespace eampc::control {
namespace {

// Position of the signal's bit `i`, counted from its least significant one for Intel and from its
// most significant one for Motorola. A Motorola signal runs down through a byte and on at bit 7 of
// the next.
int bit_position(const SignalLayout& layout, int i) noexcept {
  if (layout.little_endian) {
    return layout.start_bit + i;
  }
  const int from_top = 8 * (layout.start_bit / 8) + (7 - layout.start_bit % 8) + i;
  return 8 * (from_top / 8) + (7 - from_top % 8);
}

std::uint64_t mask_of(int length) noexcept {
  return length >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << length) - 1;
}

// 2^length of 1..64, exact.
double power_of_two(int length) noexcept {
  return 2.0 * static_cast<double>(std::uint64_t{1} << (length - 1));
}

// The frame as one number in which every signal of this byte order is a run of bits: its first byte
// is the least significant one for Intel, the most significant one for Motorola.
std::uint64_t word_of(const FrameData& data, bool little_endian) noexcept {
  if (little_endian && std::endian::native == std::endian::little) {
    return std::bit_cast<std::uint64_t>(data);
  }
  std::uint64_t word = 0;
  for (int byte = 0; byte < 8; ++byte) {
    word |= static_cast<std::uint64_t>(data[static_cast<std::size_t>(byte)])
            << (little_endian ? 8 * byte : 56 - 8 * byte);
  }
  return word;
}

void set_word(FrameData& data, bool little_endian, std::uint64_t word) noexcept {
  if (little_endian && std::endian::native == std::endian::little) {
    data = std::bit_cast<FrameData>(word);
    return;
  }
  for (int byte = 0; byte < 8; ++byte) {
    data[static_cast<std::size_t>(byte)] =
        static_cast<std::uint8_t>(word >> (little_endian ? 8 * byte : 56 - 8 * byte));
  }
}

// How far the signal's least significant bit lies above bit 0 of that number.
int shift_of(const SignalLayout& layout) noexcept {
  return layout.little_endian
             ? layout.start_bit
             : 56 - 8 * (layout.start_bit / 8) + layout.start_bit % 8 - (layout.length - 1);
}

constexpr std::uint8_t crc_of_byte(std::uint8_t byte) noexcept {
  constexpr int kPolynomial = 0x1D;
  int crc = byte;
  for (int bit = 0; bit < 8; ++bit) {
    crc = (crc << 1) ^ ((crc & 0x80) != 0 ? kPolynomial : 0);
  }
  return static_cast<std::uint8_t>(crc & 0xFF);
}

constexpr std::array<std::uint8_t, 256> kCrcTable = [] {
  std::array<std::uint8_t, 256> table{};
  for (std::size_t byte = 0; byte < table.size(); ++byte) {
    table[byte] = crc_of_byte(static_cast<std::uint8_t>(byte));
  }
  return table;
}();

std::uint8_t crc_step(std::uint8_t crc, std::uint8_t byte) noexcept {
  return kCrcTable[static_cast<std::size_t>(crc ^ byte)];
}

}  // namespace

bool fits(const SignalLayout& layout, int frame_length) noexcept {
  if (layout.length < 1 || layout.length > 64 || layout.start_bit < 0 || layout.start_bit > 63) {
    return false;
  }
  for (int i = 0; i < layout.length; ++i) {
    if (bit_position(layout, i) >= 8 * frame_length) {
      return false;
    }
  }
  return true;
}

std::uint64_t occupied_bits(const SignalLayout& layout) noexcept {
  std::uint64_t bits = 0;
  for (int i = 0; i < layout.length; ++i) {
    const int position = bit_position(layout, i);
    if (position >= 0 && position < 64) {
      bits |= std::uint64_t{1} << position;
    }
  }
  return bits;
}

std::uint64_t extract_bits(const FrameData& data, const SignalLayout& layout) noexcept {
  return (word_of(data, layout.little_endian) >> shift_of(layout)) & mask_of(layout.length);
}

void insert_bits(FrameData& data, const SignalLayout& layout, std::uint64_t raw) noexcept {
  const int shift = shift_of(layout);
  const std::uint64_t mask = mask_of(layout.length);
  const std::uint64_t word = word_of(data, layout.little_endian);
  set_word(data, layout.little_endian, (word & ~(mask << shift)) | ((raw & mask) << shift));
}

double raw_minimum(const SignalLayout& layout) noexcept {
  return layout.is_signed ? -0.5 * power_of_two(layout.length) : 0.0;
}

double raw_maximum(const SignalLayout& layout) noexcept {
  return (layout.is_signed ? 0.5 : 1.0) * power_of_two(layout.length) - 1.0;
}

double physical_of_raw(const SignalLayout& layout, std::uint64_t raw) noexcept {
  double counts = 0.0;
  if (layout.is_signed) {
    const std::uint64_t sign_bit = std::uint64_t{1} << (layout.length - 1);
    counts = static_cast<double>(static_cast<std::int64_t>((raw ^ sign_bit) - sign_bit));
  } else {
    counts = static_cast<double>(raw);
  }
  return counts * layout.factor + layout.offset;
}

double decode_signal(const FrameData& data, const SignalLayout& layout) noexcept {
  return physical_of_raw(layout, extract_bits(data, layout));
}

std::uint64_t nearest_raw(const SignalLayout& layout, double physical) noexcept {
  const double counts = std::nearbyint((physical - layout.offset) / layout.factor);
  if (std::isnan(counts)) {
    return 0;
  }
  const std::uint64_t mask = mask_of(layout.length);
  if (layout.is_signed) {
    const std::uint64_t sign_bit = std::uint64_t{1} << (layout.length - 1);
    // 2^(n−1) itself is exact as a double, 2^63 − 1 is not: compare with the former.
    if (counts >= -raw_minimum(layout)) {
      return sign_bit - 1;
    }
    if (counts <= raw_minimum(layout)) {
      return sign_bit;
    }
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(counts)) & mask;
  }
  if (counts <= 0.0) {
    return 0;
  }
  if (counts >= power_of_two(layout.length)) {
    return mask;
  }
  return static_cast<std::uint64_t>(counts);
}

void encode_signal(FrameData& data, const SignalLayout& layout, double physical) noexcept {
  insert_bits(data, layout, nearest_raw(layout, physical));
}

std::uint8_t frame_crc(const FrameData& data, int length, const CrcLayout& layout) noexcept {
  std::uint8_t crc = 0xFF;
  crc = crc_step(crc, static_cast<std::uint8_t>(layout.data_id & 0xFF));
  crc = crc_step(crc, static_cast<std::uint8_t>(layout.data_id >> 8));
  for (int byte = 0; byte < length && byte < 8; ++byte) {
    if (byte != layout.byte) {
      crc = crc_step(crc, data[static_cast<std::size_t>(byte)]);
    }
  }
  return static_cast<std::uint8_t>(crc ^ 0xFF);
}

}  // namespace eampc::control
