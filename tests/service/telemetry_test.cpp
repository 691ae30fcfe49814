// LCM over its own in-process network, memq://: no multicast needed.
#include "service/telemetry.hpp"

#include <gtest/gtest.h>

#include "service/options.hpp"

namespace eampc::service {
namespace {

TEST(Telemetry, AnUnreachableNetworkIsOneSentence) {
  for (const char* url : {"garbage", "udpm://no.such.host:1", "udpm://239.255.76.67:99999"}) {
    ::testing::internal::CaptureStderr();
    try {
      Telemetry telemetry(url, 1);
      ADD_FAILURE() << url;
    } catch (const BadInput& error) {
      const std::string sentence = error.what();
      EXPECT_NE(sentence.find(std::string("cannot reach LCM at ") + url), std::string::npos);
      EXPECT_EQ(sentence.find('\n'), std::string::npos);
    }
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");  // LCM's own lines are kept back
  }
}

TEST(Telemetry, PublishesWithoutAListener) {
  Telemetry telemetry("memq://", 2);
  realtime::LoopRecord record;
  record.cycle.limits = control::kLimitSlewRate | control::kLimitParameterBox;
  for (int i = 0; i < 4; ++i) {
    record.cycle.cycle = i;
    telemetry.publish_state(record);
  }
  telemetry.publish_health({});
}

}  // namespace
}  // namespace eampc::service
