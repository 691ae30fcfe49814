// What one non-blocking read of a bus can give. Shared by the transports, so that the loop reads
// one vocabulary.
#pragma once

#include <cstdint>

#include "control/control_types.hpp"

namespace eampc::realtime {

enum class BusEvent : std::uint8_t {
  kFrame,       // a data frame that passed the filter
  kNothing,     // no datagram is waiting
  kConfirmed,   // an own frame came back: it has been on the wire
  kErrorFrame,  // the controller reports a bus error
  kLinkDown,    // the interface is down or gone; the socket is kept and read again later
  kIgnored,     // a frame of somebody else's, or one that could not be parsed
};

struct ReceivedFrame {
  control::Frame frame;
  std::int64_t arrival_ns = 0;  // CLOCK_REALTIME stamp of the kernel; 0 if the socket gives none
};

// One identifier a transport lets through; 11 and 29 bit identifiers of equal value are different.
struct FrameFilter {
  std::uint32_t id = 0;
  bool extended = false;
};

}  // namespace eampc::realtime
