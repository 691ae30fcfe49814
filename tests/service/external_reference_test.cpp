#include "service/external_reference.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

namespace eampc::service {
namespace {

constexpr std::int64_t kNow = 1'000'000'000;

TEST(ExternalReference, IsClampedToTheRange) {
  ExternalReference external(0.8, 0.005);
  const auto inside = external.accept({0.5, 1.0, 2.0}, kNow, kNow);
  ASSERT_TRUE(inside);
  EXPECT_EQ(inside->angle_rad, 0.5);
  EXPECT_EQ(inside->velocity_rad_s, 1.0);
  const auto outside = external.accept({-2.0, 1.0, 2.0}, kNow + 5000, kNow + 5000);
  ASSERT_TRUE(outside);
  EXPECT_EQ(outside->angle_rad, -0.8);
  EXPECT_EQ(outside->velocity_rad_s, 0.0);
}

TEST(ExternalReference, TakesOnePerPeriod) {
  ExternalReference external(1.0, 0.005);
  EXPECT_TRUE(external.accept({0.1, 0, 0}, kNow, kNow));
  EXPECT_FALSE(external.accept({0.2, 0, 0}, kNow + 4999, kNow + 4999));
  EXPECT_TRUE(external.accept({0.3, 0, 0}, kNow + 5000, kNow + 5000));
}

TEST(ExternalReference, RefusesOldFutureAndSenselessSamples) {
  ExternalReference external(1.0, 0.005);
  EXPECT_FALSE(external.accept({0.1, 0, 0}, kNow - 200'001, kNow));
  EXPECT_FALSE(external.accept({0.1, 0, 0}, kNow + 200'001, kNow));
  EXPECT_FALSE(external.accept({0.1, 0, 0}, INT64_MIN, kNow));
  EXPECT_FALSE(external.accept({0.1, 0, 0}, INT64_MAX, kNow));
  EXPECT_FALSE(external.accept({std::nan(""), 0, 0}, kNow, kNow));
  EXPECT_FALSE(external.accept({0.1, INFINITY, 0}, kNow, kNow));
}

TEST(ExternalReference, ASteppedClockNeitherBlocksNorHolds) {
  ExternalReference external(1.0, 0.005);
  constexpr std::int64_t kEarlier = kNow - 3'600'000'000;
  ASSERT_TRUE(external.accept({0.1, 2.0, 0}, kNow, kNow));
  EXPECT_TRUE(external.accept({0.2, 0, 0}, kEarlier, kEarlier));
  ASSERT_TRUE(external.accept({0.3, 2.0, 0}, kNow, kNow));
  const auto held = external.expire(kEarlier);
  ASSERT_TRUE(held);
  EXPECT_EQ(held->velocity_rad_s, 0.0);
}

TEST(ExternalReference, StandsStillOnceTheSamplesStop) {
  ExternalReference external(1.0, 0.005);
  EXPECT_FALSE(external.expire(kNow));
  external.accept({0.4, 3.0, 5.0}, kNow, kNow);
  EXPECT_FALSE(external.expire(kNow + 199'999));
  const auto held = external.expire(kNow + 200'000);
  ASSERT_TRUE(held);
  EXPECT_EQ(held->angle_rad, 0.4);
  EXPECT_EQ(held->velocity_rad_s, 0.0);
  EXPECT_FALSE(external.expire(kNow + 300'000));  // once
}

}  // namespace
}  // namespace eampc::service
