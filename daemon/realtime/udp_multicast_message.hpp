// One CAN frame as python-can's `udp_multicast` interface writes it: a MessagePack map of eleven
// entries (python-can 4.6, can/interfaces/udp_multicast/utils.py). Pure, bounded by the buffer, no
// heap.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "control/control_types.hpp"

namespace eampc::realtime {

// 142 bytes of keys and fixed values, 5 for the identifier, 8 of data; python-can's own buffer has
// 4096.
inline constexpr std::size_t kUdpMessageBytes = 192;
using UdpMessage = std::array<std::uint8_t, kUdpMessageBytes>;

// Returns the number of bytes written. The channel is nil, as in a message that was never received.
std::size_t pack_udp_message(const control::Frame& frame, double timestamp_s,
                             UdpMessage& message) noexcept;

struct ParsedUdpMessage {
  control::Frame frame;
  bool is_error_frame = false;
};

// Empty if the bytes are not a classic CAN frame that python-can would accept with check=True.
std::optional<ParsedUdpMessage> parse_udp_message(std::span<const std::uint8_t> bytes) noexcept;

}  // namespace eampc::realtime
