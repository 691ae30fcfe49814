#include "realtime/bus.hpp"

#include <charconv>
#include <stdexcept>

namespace eampc::realtime {

BusAddress parse_bus_url(const std::string& url) {
  const std::size_t colon = url.find(':');
  const std::string scheme = url.substr(0, colon);
  const std::string rest = colon == std::string::npos ? "" : url.substr(colon + 1);
  BusAddress address;
  if (scheme == "socketcan" && !rest.empty()) {
    address.transport = Transport::kSocketCan;
    address.interface = rest;
    return address;
  }
  if (scheme == "udp_multicast") {
    address.transport = Transport::kUdpMulticast;
    const std::size_t separator = rest.find(':');
    const std::string group = rest.substr(0, separator);
    if (!group.empty()) address.group = group;
    if (separator != std::string::npos) {
      const std::string port = rest.substr(separator + 1);
      unsigned value = 0;
      const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), value);
      if (error != std::errc() || end != port.data() + port.size() || value < 1 || value > 65535) {
        throw std::runtime_error("--bus " + url + ": the port \"" + port +
                                 "\" is not a number from 1 to 65535");
      }
      address.port = static_cast<std::uint16_t>(value);
    }
    return address;
  }
  throw std::runtime_error("--bus " + url +
                           ": use socketcan:INTERFACE (such as socketcan:can0) or "
                           "udp_multicast:239.74.163.2:43113");
}

Bus open_bus(const BusAddress& address, const BusFrames& frames) {
  if (address.transport == Transport::kUdpMulticast) {
    return Bus(open_udp_multicast_bus(address.group, address.port, frames));
  }
  return Bus(open_can_bus(address.interface, frames));
}

}  // namespace eampc::realtime
