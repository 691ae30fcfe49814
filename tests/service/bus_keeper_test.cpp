// Decisions from reports and instants alone; that the interface really is restarted is tested on
// vcan.
#include "service/bus_keeper.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace eampc::service {
namespace {

using std::chrono::milliseconds;

TEST(RestartPolicy, AHealthyOrMerelySilentBusIsLeftAlone) {
  RestartPolicy policy;
  realtime::BusReport report;
  const RestartPolicy::Instant now{};
  EXPECT_FALSE(policy.due(report, now));
  report.health.unconfirmed_periods = 1000;  // a disabled command that waits harms nobody
  report.health.error_passive = true;
  EXPECT_FALSE(policy.due(report, now));
}

TEST(RestartPolicy, AnOldCommandIsPurgedAtOnce) {
  RestartPolicy policy;
  realtime::BusReport report;
  report.stale_command_possible = true;
  EXPECT_TRUE(policy.due(report, RestartPolicy::Instant{}));
  EXPECT_FALSE(policy.due(report, RestartPolicy::Instant{} + milliseconds(10)));
}

TEST(RestartPolicy, APersistentBusOffIsTriedLessAndLessOften) {
  RestartPolicy policy;
  realtime::BusReport report;
  report.health.bus_off = true;
  std::vector<long> seconds;
  for (int ms = 0; ms <= 70'000; ms += 10) {
    if (policy.due(report, RestartPolicy::Instant{} + milliseconds(ms))) {
      seconds.push_back(ms / 1000);
    }
  }
  EXPECT_EQ(seconds, (std::vector<long>{0, 1, 3, 7, 15, 31, 47, 63}));
}

TEST(RestartPolicy, ABusThatWorkedInBetweenIsTriedSoonAgain) {
  RestartPolicy policy;
  realtime::BusReport report;
  report.health.bus_off = true;
  for (const int s : {0, 1, 3, 7}) {
    EXPECT_TRUE(policy.due(report, RestartPolicy::Instant{} + std::chrono::seconds(s)));
  }
  report.confirmed_frames = 1;
  EXPECT_TRUE(policy.due(report, RestartPolicy::Instant{} + std::chrono::seconds(8)));
}

TEST(DescribeChange, SaysWhatChangedAndNothingElse) {
  realtime::BusReport before, after;
  EXPECT_EQ(describe_change(before, after), "");
  after.health.queue_proved_empty = true;
  EXPECT_EQ(describe_change(before, after), "the queue is proved empty");
  before = after;
  after.health.link_down = true;
  after.health.queue_proved_empty = false;
  after.link_downs = 1;
  EXPECT_EQ(describe_change(before, after), "the interface went down or away");
  before = after;
  after.health.link_down = false;
  EXPECT_EQ(describe_change(before, after), "the interface is back");
  before = after;
  after.monitor.bus_offs = 1;
  after.monitor.passives = 1;
  after.transmit_errors = 128;
  EXPECT_EQ(describe_change(before, after),
            "bus-off; error passive, counters 128 sending and 0 receiving");
  before = after;
  after.monitor.not_acknowledged = 50;
  EXPECT_NE(describe_change(before, after).find("not acknowledged"), std::string::npos);
  before = after;
  after.monitor.not_acknowledged = 500;  // told once, counted for ever
  EXPECT_EQ(describe_change(before, after), "");
}

}  // namespace
}  // namespace eampc::service
