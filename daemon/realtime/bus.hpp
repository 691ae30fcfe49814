// The transport chosen by URL. Two, known at compile time: a variant, no base class.
#pragma once

#include <string>
#include <utility>
#include <variant>

#include "realtime/can_bus.hpp"
#include "realtime/udp_multicast_bus.hpp"

namespace eampc::realtime {

class Bus {
  // std::visit may throw; two get_if cannot.
  template <typename Self, typename Action>
  static auto on_transport(Self& self, Action&& action) noexcept {
    if (auto* can = std::get_if<CanBus>(&self.bus_)) return action(*can);
    return action(*std::get_if<UdpMulticastBus>(&self.bus_));
  }

 public:
  explicit Bus(CanBus bus) noexcept : bus_(std::move(bus)) {}
  explicit Bus(UdpMulticastBus bus) noexcept : bus_(std::move(bus)) {}

  SendResult send(const control::Frame& frame) noexcept {
    return on_transport(*this, [&](auto& bus) { return bus.send(frame); });
  }
  BusEvent receive(ReceivedFrame& received) noexcept {
    return on_transport(*this, [&](auto& bus) { return bus.receive(received); });
  }
  bool reopen() noexcept {
    return on_transport(*this, [](auto& bus) { return bus.reopen(); });
  }
  bool confirms() const noexcept {
    return on_transport(*this, [](auto& bus) { return bus.confirms(); });
  }
  int fd() const noexcept {
    return on_transport(*this, [](auto& bus) { return bus.fd(); });
  }
  std::uint32_t receive_overflows() const noexcept {
    return on_transport(*this, [](auto& bus) { return bus.receive_overflows(); });
  }

 private:
  std::variant<CanBus, UdpMulticastBus> bus_;
};

enum class Transport : std::uint8_t { kSocketCan, kUdpMulticast };

// `socketcan:INTERFACE` or `udp_multicast:GROUP:PORT` (group and port may be left out).
struct BusAddress {
  Transport transport = Transport::kSocketCan;
  std::string interface;               // socketcan
  std::string group = "239.74.163.2";  // udp_multicast: python-can's defaults
  std::uint16_t port = 43113;
};

// Both throw std::runtime_error with one sentence.
BusAddress parse_bus_url(const std::string& url);
Bus open_bus(const BusAddress& address, const BusFrames& frames);

}  // namespace eampc::realtime
