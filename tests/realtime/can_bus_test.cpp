// A SOCK_SEQPACKET pair carries `struct can_frame` intact: the bus class is the real one, only the
// wire is not.
#include "realtime/can_bus.hpp"

#include <gtest/gtest.h>
#include <linux/can.h>
#include <sys/socket.h>

#include <cstring>

namespace eampc::realtime {
namespace {

class CanBusTest : public ::testing::Test {
 protected:
  CanBusTest() {
    int ends[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
    BusFrames frames;
    frames.encoder = {0x181, false};
    frames.own.add({0x201, false});
    frames.monitored.add({0x182, false});
    frames.monitored.add({0x701, false});
    bus_ = std::make_unique<CanBus>(FileDescriptor(ends[0]), frames);
    wire_ = FileDescriptor(ends[1]);
  }
  void put(canid_t id, std::uint8_t length = 8) {
    can_frame raw{};
    raw.can_id = id;
    raw.can_dlc = length;
    for (std::uint8_t i = 0; i < 8; ++i) raw.data[i] = i;
    ASSERT_EQ(::send(wire_.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
  }

  std::unique_ptr<CanBus> bus_;
  FileDescriptor wire_;
  ReceivedFrame received_;
};

TEST_F(CanBusTest, HandsOnTheEncodersFrame) {
  put(0x181, 7);
  ASSERT_EQ(bus_->receive(received_), BusEvent::kFrame);
  EXPECT_EQ(received_.frame.id, 0x181u);
  EXPECT_FALSE(received_.frame.extended);
  EXPECT_EQ(received_.frame.length, 7);
  EXPECT_EQ(received_.frame.data[6], 6);
  EXPECT_EQ(bus_->receive(received_), BusEvent::kNothing);
}

TEST_F(CanBusTest, TellsEverythingElseApart) {
  put(0x183);
  put(0x181 | CAN_EFF_FLAG);
  put(0x181 | CAN_RTR_FLAG);
  put(0x182 | CAN_EFF_FLAG);
  put(0x182 | CAN_RTR_FLAG);
  put(0x201 | CAN_EFF_FLAG);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(bus_->receive(received_), BusEvent::kIgnored);
  const char runt[3] = {};
  ASSERT_EQ(::send(wire_.get(), runt, sizeof runt, 0), 3);
  EXPECT_EQ(bus_->receive(received_), BusEvent::kIgnored);
}

TEST_F(CanBusTest, HandsOnMonitoredFramesWithTheirNumber) {
  put(0x701, 1);
  put(0x182);
  ASSERT_EQ(bus_->receive(received_), BusEvent::kMonitored);
  EXPECT_EQ(received_.monitored, 1u);
  EXPECT_EQ(received_.frame.length, 1);
  ASSERT_EQ(bus_->receive(received_), BusEvent::kMonitored);
  EXPECT_EQ(received_.monitored, 0u);
}

TEST_F(CanBusTest, TellsThatSomebodyElseSendsOurCommands) {
  put(0x201);
  EXPECT_EQ(bus_->receive(received_), BusEvent::kForeignCommand);
}

TEST_F(CanBusTest, HandsOnErrorFramesWithClassAndData) {
  put(0x244 | CAN_ERR_FLAG);
  put(0x181 | CAN_ERR_FLAG);  // no encoder frame, whatever its identifier looks like
  ASSERT_EQ(bus_->receive(received_), BusEvent::kErrorFrame);
  EXPECT_EQ(received_.frame.id, 0x244u);
  EXPECT_EQ(received_.frame.data[7], 7);
  EXPECT_EQ(bus_->receive(received_), BusEvent::kErrorFrame);
}

TEST_F(CanBusTest, WithoutAnInterfaceNothingIsConfirmedOrReopened) {
  EXPECT_FALSE(bus_->confirms());
  EXPECT_FALSE(bus_->reopen());
}

TEST_F(CanBusTest, SendsStandardAndExtendedFrames) {
  control::Frame frame;
  frame.id = 0x201;
  frame.length = 3;
  frame.data = {1, 2, 3};
  ASSERT_EQ(bus_->send(frame), SendResult::kSent);
  frame.id = 0x1abcdef0;
  frame.extended = true;
  ASSERT_EQ(bus_->send(frame), SendResult::kSent);
  can_frame raw{};
  ASSERT_EQ(::recv(wire_.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
  EXPECT_EQ(raw.can_id, 0x201u);
  EXPECT_EQ(raw.can_dlc, 3);
  EXPECT_EQ(raw.data[2], 3);
  ASSERT_EQ(::recv(wire_.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
  EXPECT_EQ(raw.can_id, 0x1abcdef0u | CAN_EFF_FLAG);
}

TEST_F(CanBusTest, AFullQueueAndAVanishedPeerAreErrorsAndNotWaits) {
  control::Frame frame;
  int sent = 0;
  while (bus_->send(frame) == SendResult::kSent && sent < 100'000) ++sent;
  EXPECT_LT(sent, 100'000);
  wire_.reset();
  EXPECT_EQ(bus_->send(frame), SendResult::kRefused);
  EXPECT_EQ(bus_->receive(received_), BusEvent::kNothing);
}

}  // namespace
}  // namespace eampc::realtime
