// Signals and checksum of one classic CAN frame. In: 8 bytes, a layout → out: raw counts or a
// physical value. Intel signals start at their least significant bit, Motorola signals at their
// most significant bit (DBC). Cost: constant per signal, one table look-up per byte of a checksum.
// Absent: value tables, multiplexing, float signals.
#pragma once

#include <array>
#include <cstdint>

#include "control/controller_config.hpp"

namespace eampc::control {

using FrameData = std::array<std::uint8_t, 8>;

// True if every bit of the signal lies inside a frame of `frame_length` bytes.
bool fits(const SignalLayout& layout, int frame_length) noexcept;
// The bits of the signal in the frame, bit 8·byte + bit_in_byte.
std::uint64_t occupied_bits(const SignalLayout& layout) noexcept;

std::uint64_t extract_bits(const FrameData& data, const SignalLayout& layout) noexcept;
void insert_bits(FrameData& data, const SignalLayout& layout, std::uint64_t raw) noexcept;

double raw_minimum(const SignalLayout& layout) noexcept;
double raw_maximum(const SignalLayout& layout) noexcept;

// Physical value = raw·factor + offset.
double decode_signal(const FrameData& data, const SignalLayout& layout) noexcept;
// Rounds to the nearest count (half to even), saturates at the signal's raw range. Not a number →
// raw 0.
std::uint64_t nearest_raw(const SignalLayout& layout, double physical) noexcept;
double physical_of_raw(const SignalLayout& layout, std::uint64_t raw) noexcept;
void encode_signal(FrameData& data, const SignalLayout& layout, double physical) noexcept;

// SAE J1850 CRC-8 (polynomial 0x1D, initial and final XOR 0xFF; "123456789" gives 0x4B) over the
// data id's low and high byte, then the frame's `length` bytes but the CRC's own.
std::uint8_t frame_crc(const FrameData& data, int length, const CrcLayout& layout) noexcept;

}  // namespace eampc::control
