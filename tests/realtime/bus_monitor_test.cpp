// The monitor against a model of the kernel's queue that is told nothing of its rules: frames go in
// and come back in order, or are lost, and the model knows which of them are old.
#include "realtime/bus_monitor.hpp"

#include <gtest/gtest.h>

#include <deque>
#include <random>

namespace eampc::realtime {
namespace {

constexpr std::int64_t kPeriod = 5'000'000;

control::Frame numbered(std::uint32_t number) {
  control::Frame frame;
  frame.id = 0x201;
  frame.length = 8;
  for (std::size_t i = 0; i < 4; ++i) frame.data[i] = static_cast<std::uint8_t>(number >> (8 * i));
  return frame;
}

class BusMonitorTest : public ::testing::Test {
 protected:
  BusMonitor::Command wanted(bool enabled) { return {numbered(++number_), enabled}; }
  // As the loop does it; true if the frame went out.
  bool command(bool enabled) {
    const BusMonitor::Command next = wanted(enabled);
    if (!monitor_.admit(next, now_)) return false;
    monitor_.on_sent(next, now_);
    last_sent_ = next.frame;
    return true;
  }
  bool confirm() { return monitor_.on_confirmed(last_sent_, kept_); }
  void prove() {
    ASSERT_TRUE(command(false));
    confirm();
    ASSERT_TRUE(monitor_.health(now_).queue_proved_empty);
  }
  ErrorReport bus_off() {
    ErrorReport report;
    report.bus_off = true;
    return report;
  }
  ErrorReport restarted() {
    ErrorReport report;
    report.restarted = true;
    return report;
  }
  ErrorReport state(ErrorState state) {
    ErrorReport report;
    report.state = state;
    return report;
  }

  BusMonitor monitor_{kPeriod, true};
  std::int64_t now_ = 1'000 * kPeriod;
  std::uint32_t number_ = 0;
  control::Frame last_sent_;
  BusMonitor::Command kept_;
};

TEST_F(BusMonitorTest, AQueueIsProvedEmptyByAConfirmedDisabledCommandOnly) {
  EXPECT_FALSE(monitor_.health(now_).queue_proved_empty);
  EXPECT_FALSE(command(true));  // not even sent
  EXPECT_TRUE(command(false));
  EXPECT_FALSE(monitor_.health(now_).queue_proved_empty);
  confirm();
  EXPECT_TRUE(monitor_.health(now_).queue_proved_empty);
  EXPECT_TRUE(command(true));
}

TEST_F(BusMonitorTest, ABusThatConfirmsNothingIsHealthyFromTheStart) {
  BusMonitor monitor(kPeriod, false);
  for (int i = 0; i < 5; ++i) {
    const BusMonitor::Command next = wanted(true);
    EXPECT_TRUE(monitor.admit(next, now_));
    monitor.on_sent(next, now_);
    const control::BusHealth health = monitor.take_health(now_ + 100 * kPeriod);
    EXPECT_TRUE(health.queue_proved_empty);
    EXPECT_EQ(health.unconfirmed_periods, 0);
    EXPECT_FALSE(health.link_down || health.bus_off || health.error_passive);
  }
}

TEST_F(BusMonitorTest, TheNewestWantedCommandFollowsTheConfirmation) {
  prove();
  ASSERT_TRUE(command(true));
  EXPECT_FALSE(command(true));
  EXPECT_FALSE(command(true));
  EXPECT_FALSE(command(false));
  const control::Frame newest = numbered(number_);
  EXPECT_TRUE(confirm());
  EXPECT_EQ(kept_.frame.data, newest.data);
  EXPECT_FALSE(kept_.enabled);
  EXPECT_EQ(monitor_.counters().withheld_commands, 3);
  EXPECT_FALSE(monitor_.in_flight());
}

TEST_F(BusMonitorTest, AnEnabledCommandIsKeptForOneAndAHalfPeriodsOnly) {
  for (const bool enabled : {true, false}) {
    for (const bool late : {true, false}) {
      prove();
      ASSERT_TRUE(command(true));
      EXPECT_FALSE(command(enabled));
      ASSERT_TRUE(confirm());
      now_ += kPeriod + kPeriod / 2 + (late ? 1 : 0);
      EXPECT_EQ(monitor_.admit(kept_, now_), !(enabled && late));
    }
  }
  EXPECT_EQ(monitor_.counters().withheld_commands, 4);
}

TEST_F(BusMonitorTest, ACommandRefusedBeforeTheProofIsWithheld) {
  EXPECT_FALSE(command(true));
  EXPECT_EQ(monitor_.counters().withheld_commands, 1);
}

TEST_F(BusMonitorTest, UnconfirmedPeriodsAreCountedFromTheSending) {
  prove();
  EXPECT_EQ(monitor_.health(now_).unconfirmed_periods, 0);
  ASSERT_TRUE(command(true));
  for (int period = 1; period < 6; ++period) {
    // A cycle comes half a millisecond early or late: the count is the same.
    EXPECT_EQ(monitor_.health(now_ + period * kPeriod - kPeriod / 10).unconfirmed_periods, period);
    EXPECT_EQ(monitor_.health(now_ + period * kPeriod + kPeriod / 10).unconfirmed_periods, period);
  }
  confirm();
  EXPECT_EQ(monitor_.health(now_ + 6 * kPeriod).unconfirmed_periods, 0);
}

TEST_F(BusMonitorTest, WhatHappenedIsToldOnceAndWhatLastsUntilItIsOver) {
  prove();
  ErrorReport report;
  report.not_acknowledged = true;
  monitor_.on_error_frame(report);
  monitor_.on_refused();
  EXPECT_TRUE(monitor_.health(now_).not_acknowledged);
  control::BusHealth health = monitor_.take_health(now_);
  EXPECT_TRUE(health.not_acknowledged);
  EXPECT_TRUE(health.send_refused);
  health = monitor_.take_health(now_);
  EXPECT_FALSE(health.not_acknowledged);
  EXPECT_FALSE(health.send_refused);

  monitor_.on_error_frame(state(ErrorState::kPassive));
  monitor_.on_error_frame(state(ErrorState::kPassive));
  EXPECT_EQ(monitor_.counters().passives, 1);
  EXPECT_TRUE(monitor_.take_health(now_).error_passive);
  EXPECT_TRUE(monitor_.take_health(now_).error_passive);
  monitor_.on_error_frame(state(ErrorState::kUnsaid));
  EXPECT_TRUE(monitor_.take_health(now_).error_passive);
  monitor_.on_error_frame(state(ErrorState::kWarning));
  EXPECT_FALSE(monitor_.take_health(now_).error_passive);
  // Between two cycles there and gone again: still told.
  monitor_.on_error_frame(state(ErrorState::kPassive));
  monitor_.on_error_frame(state(ErrorState::kActive));
  EXPECT_TRUE(monitor_.take_health(now_).error_passive);
  EXPECT_FALSE(monitor_.take_health(now_).error_passive);
}

TEST_F(BusMonitorTest, BusOffNeedsARestartAndAProbe) {
  prove();
  ASSERT_TRUE(command(true));
  monitor_.on_error_frame(bus_off());
  EXPECT_TRUE(monitor_.take_health(now_).bus_off);
  EXPECT_TRUE(monitor_.take_health(now_).bus_off);
  EXPECT_TRUE(monitor_.stale_command_possible(now_));
  EXPECT_TRUE(command(false));  // write() succeeds and the frame is lost
  EXPECT_FALSE(command(false));
  monitor_.on_error_frame(restarted());
  EXPECT_FALSE(monitor_.health(now_).bus_off);
  EXPECT_FALSE(monitor_.health(now_).queue_proved_empty);
  EXPECT_FALSE(command(true));
  EXPECT_TRUE(command(false));
  confirm();
  EXPECT_TRUE(monitor_.health(now_).queue_proved_empty);
  EXPECT_FALSE(monitor_.stale_command_possible(now_));
  EXPECT_TRUE(command(true));
}

TEST_F(BusMonitorTest, ARestartTellsOfTheBusOffNobodyTold) {
  prove();
  ASSERT_TRUE(command(true));
  monitor_.on_error_frame(restarted());
  EXPECT_TRUE(monitor_.take_health(now_).bus_off);
  EXPECT_FALSE(monitor_.take_health(now_).bus_off);
  EXPECT_EQ(monitor_.counters().bus_offs, 1);
  monitor_.on_error_frame(bus_off());
  EXPECT_TRUE(monitor_.take_health(now_).bus_off);
  monitor_.on_error_frame(restarted());
  EXPECT_FALSE(monitor_.take_health(now_).bus_off);
  EXPECT_EQ(monitor_.counters().bus_offs, 2);
}

TEST_F(BusMonitorTest, AReplayedCommandProvesNothing) {
  prove();
  ASSERT_TRUE(command(true));
  const control::Frame old = last_sent_;
  monitor_.on_error_frame(bus_off());
  monitor_.on_error_frame(restarted());
  ASSERT_TRUE(command(false));
  EXPECT_FALSE(monitor_.on_confirmed(old, kept_));  // it was still in the queue
  EXPECT_EQ(monitor_.counters().stray_confirmations, 1);
  EXPECT_FALSE(monitor_.health(now_).queue_proved_empty);
  confirm();
  EXPECT_TRUE(monitor_.health(now_).queue_proved_empty);
}

TEST_F(BusMonitorTest, AConfirmedFrameEndsABusOffNobodyEnds) {
  prove();
  monitor_.on_error_frame(bus_off());  // forged, or its restart went unheard
  ASSERT_TRUE(command(false));
  confirm();
  EXPECT_TRUE(monitor_.take_health(now_).bus_off);
  EXPECT_FALSE(monitor_.take_health(now_).bus_off);
}

TEST_F(BusMonitorTest, ALostLinkPurgesAndIsOverWithTheFirstFrameSent) {
  prove();
  monitor_.on_error_frame(state(ErrorState::kPassive));
  ASSERT_TRUE(command(true));
  monitor_.on_link_lost();
  control::BusHealth health = monitor_.take_health(now_);
  EXPECT_TRUE(health.link_down);
  EXPECT_FALSE(health.queue_proved_empty);
  EXPECT_EQ(health.unconfirmed_periods, 0);
  EXPECT_FALSE(monitor_.stale_command_possible(now_));
  health = monitor_.take_health(now_);
  EXPECT_TRUE(health.link_down);
  EXPECT_FALSE(health.error_passive);  // a controller that starts again counts from 0
  EXPECT_TRUE(command(false));
  EXPECT_FALSE(monitor_.take_health(now_).link_down);
}

TEST_F(BusMonitorTest, AnEnabledCommandThatStaysUnconfirmedIsStale) {
  prove();
  ASSERT_TRUE(command(true));
  EXPECT_FALSE(monitor_.stale_command_possible(now_ + kPeriod));
  EXPECT_TRUE(monitor_.stale_command_possible(now_ + 2 * kPeriod));
  monitor_.on_link_lost();
  ASSERT_TRUE(command(false));
  EXPECT_FALSE(monitor_.stale_command_possible(now_ + 100 * kPeriod));
}

TEST_F(BusMonitorTest, ALostConfirmationIsGivenUpWhereOthersAreHeard) {
  prove();
  ASSERT_TRUE(command(true));
  now_ += BusMonitor::kLostNs;
  EXPECT_FALSE(command(false));  // a silent bus: the frame waits, nothing is added
  monitor_.on_received();
  EXPECT_FALSE(command(true));  // and no enabled command either way
  EXPECT_TRUE(command(false));
  EXPECT_EQ(monitor_.counters().lost_confirmations, 1);
  EXPECT_TRUE(monitor_.stale_command_possible(now_));
  EXPECT_FALSE(monitor_.health(now_).queue_proved_empty);
  confirm();
  EXPECT_TRUE(monitor_.health(now_).queue_proved_empty);
}

TEST_F(BusMonitorTest, OneSyncInFlight) {
  control::Frame sync;
  sync.id = 0x80;
  sync.length = 1;
  ASSERT_TRUE(monitor_.admit_sync(now_));
  monitor_.on_sync_sent(sync, now_);
  EXPECT_FALSE(monitor_.admit_sync(now_ + kPeriod));
  EXPECT_TRUE(command(false));  // the command has its own place
  EXPECT_FALSE(monitor_.on_confirmed(sync, kept_));
  EXPECT_TRUE(monitor_.admit_sync(now_ + kPeriod));
  EXPECT_TRUE(monitor_.in_flight());
  EXPECT_EQ(monitor_.counters().stray_confirmations, 0);
}

// Whatever the bus does: at most one frame of the time since the last loss of the link waits in the
// kernel, an enabled one only behind an empty queue, and none is sent before the proof.
TEST_F(BusMonitorTest, RandomBusesNeverHoldASecondCommandOfOneTime) {
  struct Waiting {
    control::Frame frame;
    bool enabled;
  };
  for (std::uint32_t seed = 1; seed <= 200; ++seed) {
    std::mt19937 random(seed);
    const auto one_in = [&](std::uint32_t n) { return random() % n == 0; };
    BusMonitor monitor(kPeriod, true);
    std::deque<Waiting> queue;
    for (int i = static_cast<int>(random() % 12); i > 0; --i) {
      queue.push_back({numbered(0x8000'0000u + static_cast<std::uint32_t>(i)), true});
    }
    bool off = false;
    std::int64_t now = 0;
    std::int64_t enabled_sent = 0;
    const auto send = [&](const BusMonitor::Command& next) {
      if (next.enabled) {
        ASSERT_TRUE(queue.empty()) << "seed " << seed;
        ++enabled_sent;
      }
      if (!off) queue.push_back({next.frame, next.enabled});
      monitor.on_sent(next, now);
    };
    for (int step = 0; step < 3000; ++step) {
      now += kPeriod;
      if (one_in(200)) {
        monitor.on_error_frame(bus_off());
        off = true;
        if (one_in(2)) queue.clear();
      } else if (off && one_in(10)) {
        off = false;
        monitor.on_error_frame(restarted());
      } else if (one_in(300)) {
        queue.clear();
        off = false;
        monitor.on_link_lost();
      }
      const bool stuck = step % 500 < 20;
      while (!off && !stuck && !queue.empty() && !one_in(4)) {
        const control::Frame done = queue.front().frame;
        queue.pop_front();
        BusMonitor::Command kept;
        const bool ours = (done.data[3] & 0x80u) == 0;
        if (ours && monitor.on_confirmed(done, kept) && monitor.admit(kept, now)) send(kept);
      }
      if (one_in(3)) monitor.on_received();
      const BusMonitor::Command next{numbered(static_cast<std::uint32_t>(step)), !one_in(3)};
      if (monitor.admit(next, now)) send(next);
      if (HasFatalFailure()) return;
    }
    EXPECT_GT(enabled_sent, 0) << "seed " << seed;
  }
}

// Found by fuzzing: a rolling counter wraps, and the late confirmation of an old disabled command
// proved a queue empty in which an enabled one still waited.
TEST_F(BusMonitorTest, AProbeDiffersFromWhatIsOlderThanAnEnabledCommand) {
  const BusMonitor::Command old_disabled{numbered(3), false};
  const BusMonitor::Command enabled{numbered(4), true};
  const auto send = [&](const BusMonitor::Command& wanted) {
    ASSERT_TRUE(monitor_.admit(wanted, now_));
    monitor_.on_sent(wanted, now_);
  };
  // Waiting in the controller from here on: 3 (given up), 3 again, whose proof is the first's.
  send(old_disabled);
  monitor_.on_error_frame(bus_off());
  send(old_disabled);
  monitor_.on_confirmed(old_disabled.frame, kept_);
  ASSERT_TRUE(monitor_.health(now_).queue_proved_empty);
  send(enabled);
  monitor_.on_error_frame(bus_off());
  EXPECT_FALSE(monitor_.admit(old_disabled, now_));
  const BusMonitor::Command other{numbered(5), false};
  send(other);
  monitor_.on_confirmed(old_disabled.frame, kept_);
  EXPECT_FALSE(monitor_.health(now_).queue_proved_empty);
  monitor_.on_confirmed(enabled.frame, kept_);
  monitor_.on_confirmed(other.frame, kept_);
  EXPECT_TRUE(monitor_.health(now_).queue_proved_empty);
}

}  // namespace
}  // namespace eampc::realtime
