// Which heartbeat asks for CANopen's start, and what such a node counts as.
#include <gtest/gtest.h>

#include "control/controller_config.hpp"
#include "control/monitor_codec.hpp"

namespace eampc::control {
namespace {

constexpr std::uint8_t kBootUp = 0, kStopped = 4, kOperational = 5, kPreOperational = 127;

class NodeStartTest : public testing::Test {
 protected:
  NodeStartTest() {
    config_.heartbeat.present = true;
    config_.heartbeat.id = 0x702;
    config_.heartbeat.length = 1;
    config_.heartbeat.state = {.present = true, .start_bit = 0, .length = 8};
    config_.node_start.present = true;
  }
  static Frame heartbeat(std::uint8_t state) {
    Frame frame;
    frame.id = 0x702;
    frame.length = 1;
    frame.data[0] = state;
    return frame;
  }
  bool alive_after(std::uint8_t state) const {
    MonitorCodec codec(config_);
    codec.observe(heartbeat(state));
    return codec.take().heartbeat_seen;
  }

  ControllerConfig config_;
};

TEST_F(NodeStartTest, OnlyAnOperationalNodeIsAlive) {
  const MonitorCodec codec(config_);
  for (const std::uint8_t state : {kBootUp, kStopped, kPreOperational}) {
    EXPECT_TRUE(codec.asks_for_start(heartbeat(state))) << int{state};
    EXPECT_FALSE(alive_after(state)) << int{state};
  }
  EXPECT_FALSE(codec.asks_for_start(heartbeat(kOperational)));
  EXPECT_TRUE(alive_after(kOperational));
}

TEST_F(NodeStartTest, ARigWithoutStartAsksForNone) {
  config_.node_start.present = false;
  EXPECT_FALSE(MonitorCodec(config_).asks_for_start(heartbeat(kPreOperational)));
  EXPECT_TRUE(alive_after(kPreOperational));
}

TEST_F(NodeStartTest, OtherFramesAskForNothing) {
  const MonitorCodec codec(config_);
  Frame frame = heartbeat(kPreOperational);
  frame.id = 0x701;
  EXPECT_FALSE(codec.asks_for_start(frame));
  frame = heartbeat(kPreOperational);
  frame.length = 0;
  EXPECT_FALSE(codec.asks_for_start(frame));
  frame = heartbeat(kPreOperational);
  frame.remote = true;
  EXPECT_FALSE(codec.asks_for_start(frame));
}

}  // namespace
}  // namespace eampc::control
