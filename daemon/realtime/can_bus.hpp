// SocketCAN: classic CAN frames through one raw socket, non-blocking.
//   in: a file descriptor that carries `struct can_frame` (a bound CAN_RAW socket, or a
//   SOCK_SEQPACKET pair in a test) cost: one system call per send or receive, three per reopen, no
//   heap, no lock
// Deliberately absent: waiting (the loop polls fd()), any judgement of what happened
// (bus_monitor.hpp), CAN FD.
#pragma once

#include <net/if.h>

#include <array>
#include <cstdint>
#include <string>

#include "realtime/bus_event.hpp"
#include "realtime/file_descriptor.hpp"

namespace eampc::realtime {

class CanBus {
 public:
  // Takes ownership. Frames that `frames` does not name are not handed on, whatever the kernel's
  // filter let through. Such a bus confirms nothing and cannot be reopened.
  CanBus(FileDescriptor fd, const BusFrames& frames) noexcept;

  SendResult send(const control::Frame& frame) noexcept;
  BusEvent receive(ReceivedFrame& received) noexcept;
  // After kLinkGone: binds the socket to the interface of the same name once it is there again.
  bool reopen() noexcept;

  int fd() const noexcept { return fd_.get(); }
  // Own frames come back as kConfirmed once they have been on the wire.
  bool confirms() const noexcept { return interface_[0] != '\0'; }
  // Frames the kernel dropped because nobody read them in time (SO_RXQ_OVFL).
  std::uint32_t receive_overflows() const noexcept { return receive_overflows_; }

 private:
  friend CanBus open_can_bus(const std::string& interface, const BusFrames& frames);
  bool set_filters() const noexcept;
  bool bind_to_interface() const noexcept;

  FileDescriptor fd_;
  BusFrames frames_;
  std::array<char, IFNAMSIZ> interface_{};
  std::uint32_t receive_overflows_ = 0;
};

// Opens and binds `interface`. The kernel hands on exactly `frames` and error frames. Throws
// std::runtime_error with one sentence.
CanBus open_can_bus(const std::string& interface, const BusFrames& frames);

}  // namespace eampc::realtime
