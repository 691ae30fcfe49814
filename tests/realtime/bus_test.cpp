#include "realtime/bus.hpp"

#include <gtest/gtest.h>

#include <stdexcept>

namespace eampc::realtime {
namespace {

TEST(BusAddress, ReadsBothTransports) {
  const BusAddress can = parse_bus_url("socketcan:can0");
  EXPECT_EQ(can.transport, Transport::kSocketCan);
  EXPECT_EQ(can.interface, "can0");
  const BusAddress udp = parse_bus_url("udp_multicast:239.1.2.3:1234");
  EXPECT_EQ(udp.transport, Transport::kUdpMulticast);
  EXPECT_EQ(udp.group, "239.1.2.3");
  EXPECT_EQ(udp.port, 1234);
  for (const char* url : {"udp_multicast", "udp_multicast:", "udp_multicast:239.74.163.2"}) {
    EXPECT_EQ(parse_bus_url(url).group, "239.74.163.2");  // python-can's defaults
    EXPECT_EQ(parse_bus_url(url).port, 43113);
  }
}

TEST(BusAddress, RefusesTheRest) {
  for (const char* url : {"", "can0", "socketcan:", "udp:1.2.3.4", "udp_multicast:239.1.2.3:0",
                          "udp_multicast:239.1.2.3:65536", "udp_multicast:239.1.2.3:12x"}) {
    EXPECT_THROW(parse_bus_url(url), std::runtime_error) << url;
  }
}

}  // namespace
}  // namespace eampc::realtime
