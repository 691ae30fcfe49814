#include "realtime/latency_histogram.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace eampc::realtime {
namespace {

TEST(LatencyHistogram, QuantilesAreWithinThreePercentOfTheTruth) {
  LatencyHistogram histogram;
  for (int us = 1; us <= 100'000; ++us) histogram.add(us);
  for (const double share : {0.01, 0.5, 0.9, 0.99, 0.999}) {
    const double truth = share * 100'000.0;
    EXPECT_NEAR(histogram.quantile_us(share), truth, 0.035 * truth) << share;
  }
  EXPECT_EQ(histogram.max_us(), 100'000.0);
}

TEST(LatencyHistogram, TakesWhateverAClockGives) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.quantile_us(0.5), 0.0);
  for (const double us : {-5.0, std::nan(""), 0.0, 1e30}) histogram.add(us);
  EXPECT_GE(histogram.quantile_us(1.0), 1.6e7);  // the last bin ends at 2^24 µs
}

}  // namespace
}  // namespace eampc::realtime
