// Golden bytes: printed by python-can 4.6.1's pack_message() for the messages named beside them.
#include "realtime/udp_multicast_message.hpp"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

namespace eampc::realtime {
namespace {

std::vector<std::uint8_t> from_hex(const std::string& hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(hex.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

// Message(arbitration_id=0x181, is_extended_id=False, data=bytes(range(8)), timestamp=1234.5)
const std::string kDataFrame =
    "8ba974696d657374616d70cb40934a0000000000ae6172626974726174696f6e5f6964cd0181ae69735f657874656e"
    "64"
    "65645f6964c2af69735f72656d6f74655f6672616d65c2ae69735f6572726f725f6672616d65c2a76368616e6e656c"
    "c0"
    "a3646c6308a464617461c4080001020304050607a569735f6664c2ae626974726174655f737769746368c2b5657272"
    "6f"
    "725f73746174655f696e64696361746f72c2";
// Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, timestamp=0, channel="abc",
// is_remote_frame=True, dlc=4)
const std::string kRemoteFrame =
    "8ba974696d657374616d7000ae6172626974726174696f6e5f6964ce1abcdef0ae69735f657874656e6465645f6964"
    "c3"
    "af69735f72656d6f74655f6672616d65c3ae69735f6572726f725f6672616d65c2a76368616e6e656ca3616263a364"
    "6c"
    "6304a464617461c400a569735f6664c2ae626974726174655f737769746368c2b56572726f725f73746174655f696e"
    "64"
    "696361746f72c2";

control::Frame data_frame() {
  control::Frame frame;
  frame.id = 0x181;
  frame.length = 8;
  for (std::uint8_t i = 0; i < 8; ++i) frame.data[i] = i;
  return frame;
}

TEST(UdpMulticastMessage, WritesWhatPythonCanWrites) {
  UdpMessage message;
  const std::size_t size = pack_udp_message(data_frame(), 1234.5, message);
  EXPECT_EQ(std::vector<std::uint8_t>(message.begin(), message.begin() + static_cast<long>(size)),
            from_hex(kDataFrame));
}

TEST(UdpMulticastMessage, ReadsWhatPythonCanWrites) {
  const auto data = parse_udp_message(from_hex(kDataFrame));
  ASSERT_TRUE(data);
  EXPECT_EQ(data->frame.id, 0x181u);
  EXPECT_FALSE(data->frame.extended);
  EXPECT_FALSE(data->frame.remote);
  EXPECT_EQ(data->frame.length, 8);
  EXPECT_EQ(data->frame.data, data_frame().data);

  const auto remote = parse_udp_message(from_hex(kRemoteFrame));
  ASSERT_TRUE(remote);
  EXPECT_EQ(remote->frame.id, 0x1ABCDEF0u);
  EXPECT_TRUE(remote->frame.extended);
  EXPECT_TRUE(remote->frame.remote);
  EXPECT_EQ(remote->frame.length, 4);
}

TEST(UdpMulticastMessage, TheLargestMessageFitsTheBuffer) {
  control::Frame frame = data_frame();
  frame.id = 0x1fffffff;
  frame.extended = true;
  UdpMessage message;
  EXPECT_LE(pack_udp_message(frame, 1e300, message), message.size());
}

TEST(UdpMulticastMessage, SurvivesAnyCutAndAnyChangedByte) {
  const std::vector<std::uint8_t> whole = from_hex(kDataFrame);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_FALSE(parse_udp_message(std::span(whole).first(size))) << size;
  }
  std::mt19937 random(1);
  for (int i = 0; i < 200'000; ++i) {
    std::vector<std::uint8_t> bytes = whole;
    const std::size_t changes = 1 + random() % 4;
    for (std::size_t j = 0; j < changes; ++j) {
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    }
    const auto parsed = parse_udp_message(bytes);
    if (parsed) {
      EXPECT_LE(parsed->frame.length, 8);
      EXPECT_LT(parsed->frame.id, 1u << (parsed->frame.extended ? 29 : 11));
    }
  }
}

}  // namespace
}  // namespace eampc::realtime
