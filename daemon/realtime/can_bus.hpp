// SocketCAN: classic CAN frames through one raw socket, non-blocking.
//   in: a file descriptor that carries `struct can_frame` (a bound CAN_RAW socket, or a
//   SOCK_SEQPACKET pair in a test) cost: one system call per send or receive, no heap, no lock
// Deliberately absent: waiting (the loop polls fd()), reconnecting after an interface was deleted,
// CAN FD.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "realtime/bus_event.hpp"
#include "realtime/file_descriptor.hpp"

namespace eampc::realtime {

class CanBus {
 public:
  // Takes ownership. Frames whose identifier is not `encoder` are not handed on, whatever the
  // kernel's filter let through.
  CanBus(FileDescriptor fd, FrameFilter encoder) noexcept;

  bool send(const control::Frame& frame) noexcept;
  BusEvent receive(ReceivedFrame& received) noexcept;

  int fd() const noexcept { return fd_.get(); }
  // Frames the kernel dropped because nobody read them in time (SO_RXQ_OVFL).
  std::uint32_t receive_overflows() const noexcept { return receive_overflows_; }

 private:
  FileDescriptor fd_;
  FrameFilter encoder_;
  std::uint32_t receive_overflows_ = 0;
};

// Opens and binds `interface`. The kernel hands on exactly `encoder` and the frames in `own` (they
// come back as transmit confirmations), and error frames. Throws std::runtime_error with one
// sentence.
CanBus open_can_bus(const std::string& interface, FrameFilter encoder,
                    std::span<const FrameFilter> own);

}  // namespace eampc::realtime
