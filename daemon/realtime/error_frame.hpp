// Reads a SocketCAN error frame (linux/can/error.h): class bits in the identifier, details in the
// eight bytes. Pure; a combination nobody defined reads as nothing said.
#pragma once

#include <cstdint>

#include "control/control_types.hpp"

namespace eampc::realtime {

enum class ErrorState : std::uint8_t {
  kUnsaid,   // the frame is about something else
  kActive,   // both counters below 96
  kWarning,  // one at 96 or more
  kPassive,  // one above 127
};

struct ErrorReport {
  bool bus_off = false;
  bool restarted = false;         // the controller is back after bus-off
  bool not_acknowledged = false;  // nobody acknowledged a frame of ours
  bool receive_overflow = false;  // the controller's own buffer ran over
  ErrorState state = ErrorState::kUnsaid;
  bool has_counters = false;
  std::uint8_t transmit_errors = 0;
  std::uint8_t receive_errors = 0;
};

// `frame` as BusEvent::kErrorFrame leaves it.
ErrorReport decode_error_frame(const control::Frame& frame) noexcept;

}  // namespace eampc::realtime
