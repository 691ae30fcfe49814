// What one non-blocking read or write of a bus can give. Shared by the transports, so that the loop
// reads one vocabulary.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "control/control_types.hpp"

namespace eampc::realtime {

enum class BusEvent : std::uint8_t {
  kFrame,           // the encoder's data frame
  kMonitored,       // a data frame of a monitored message; ReceivedFrame::monitored says which
  kNothing,         // nothing is waiting
  kConfirmed,       // an own frame came back: it has been on the wire
  kForeignCommand,  // a frame with an own identifier that this socket did not send
  kErrorFrame,      // the controller reports; decode_error_frame() reads ReceivedFrame::frame
  kLinkDown,        // the interface is down; the socket works again once it is up
  kLinkGone,        // the interface was deleted; reopen()
  kIgnored,         // a frame of somebody else's, or one that could not be parsed
};

enum class SendResult : std::uint8_t {
  kSent,
  kRefused,   // ENOBUFS and whatever else is the moment's
  kLinkDown,  // as above
  kLinkGone,  // as above
};

struct ReceivedFrame {
  // Of an error frame: `id` is the error class without CAN_ERR_FLAG, `data` its eight bytes.
  control::Frame frame;
  std::int64_t arrival_ns = 0;  // CLOCK_REALTIME stamp of the kernel; 0 if the socket gives none
  std::size_t monitored = 0;    // index in BusFrames::monitored
};

// One identifier a transport lets through; 11 and 29 bit identifiers of equal value are different.
struct FrameFilter {
  std::uint32_t id = 0;
  bool extended = false;

  bool matches(const control::Frame& frame) const noexcept {
    return frame.id == id && frame.extended == extended && !frame.remote;
  }
};

// Eight: valve feedback, heartbeat, emergency, emergency stop, and as many again.
struct FrameFilterList {
  static constexpr std::size_t kMax = 8;
  std::array<FrameFilter, kMax> filter{};
  std::size_t count = 0;

  bool add(FrameFilter added) noexcept {
    if (count == kMax) return false;
    filter[count++] = added;
    return true;
  }
  // The index of the filter that matches, or kMax.
  std::size_t find(const control::Frame& frame) const noexcept {
    for (std::size_t i = 0; i < count; ++i) {
      if (filter[i].matches(frame)) return i;
    }
    return kMax;
  }
};

struct BusFrames {
  FrameFilter encoder;
  FrameFilterList own{};        // what the daemon sends itself
  FrameFilterList monitored{};  // what else it reads
};

}  // namespace eampc::realtime
