// python-can's `udp_multicast` bus (IPv4), for emulation on any machine. Same interface as CanBus.
//   cost: one system call per send or receive, parsing bounded by a 512-byte buffer, no heap, no
//   lock
// Deliberately absent: IPv6, CAN FD, transmit confirmation (UDP has none).
// Own frames come back (every member shares the port) and cannot be told from a stranger's: what
// carries an own identifier is dropped.
#pragma once

#include <netinet/in.h>

#include <array>
#include <cstdint>
#include <string>

#include "realtime/bus_event.hpp"
#include "realtime/file_descriptor.hpp"

namespace eampc::realtime {

class UdpMulticastBus {
 public:
  // Datagrams from addresses that are not this machine's own are ignored: emulation never leaves
  // the machine. 32 are more than a test machine with containers has; further ones are not local.
  static constexpr std::size_t kMaxLocalAddresses = 32;
  struct LocalAddresses {
    std::array<in_addr_t, kMaxLocalAddresses> address{};
    std::size_t count = 0;
  };

  UdpMulticastBus(FileDescriptor fd, const sockaddr_in& group, const LocalAddresses& local,
                  const BusFrames& frames) noexcept;

  SendResult send(const control::Frame& frame) noexcept;
  BusEvent receive(ReceivedFrame& received) noexcept;

  bool reopen() noexcept { return false; }

  int fd() const noexcept { return fd_.get(); }
  bool confirms() const noexcept { return false; }
  std::uint32_t receive_overflows() const noexcept { return receive_overflows_; }

 private:
  FileDescriptor fd_;
  sockaddr_in group_{};
  LocalAddresses local_;
  BusFrames frames_;
  std::uint32_t receive_overflows_ = 0;
};

// Joins `group`:`port` with time-to-live 0. Throws std::runtime_error with one sentence.
UdpMulticastBus open_udp_multicast_bus(const std::string& group, std::uint16_t port,
                                       const BusFrames& frames);

}  // namespace eampc::realtime
