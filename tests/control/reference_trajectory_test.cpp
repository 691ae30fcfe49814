#include "control/reference_trajectory.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace eampc::control {
namespace {

TEST(ReferenceTrajectory, ConstantHasNoDerivatives) {
  ReferenceTrajectory t;
  t.amplitude_rad = 0.3;
  const Reference r = reference_at(t, 12.0);
  EXPECT_EQ(r.angle_rad, 0.3);
  EXPECT_EQ(r.velocity_rad_s, 0.0);
  EXPECT_EQ(r.acceleration_rad_s2, 0.0);
}

TEST(ReferenceTrajectory, StepBeginsInTheCycleOfItsTime) {
  ReferenceTrajectory t;
  t.kind = ReferenceKind::kStep;
  t.amplitude_rad = 0.5;
  t.offset_rad = -0.1;
  t.start_s = 0.3;
  EXPECT_DOUBLE_EQ(reference_at(t, 0.295).angle_rad, -0.1);
  // 60·0.005 is one rounding below 0.3 on some machines; it must still be the step's cycle.
  EXPECT_DOUBLE_EQ(reference_at(t, std::nextafter(0.3, 0.0)).angle_rad, 0.4);
}

// A sin ωt at t = 1/(12 f): sin 30° = ½, derivatives ωA cos 30° and −ω²A/2, ω = π for 0.5 Hz.
TEST(ReferenceTrajectory, SineByHand) {
  ReferenceTrajectory t;
  t.kind = ReferenceKind::kSine;
  t.amplitude_rad = 0.5;
  t.frequency_hz = 0.5;
  t.start_s = 1.0;
  t.offset_rad = 0.2;
  const Reference r = reference_at(t, 1.0 + 1.0 / 6.0);
  EXPECT_NEAR(r.angle_rad, 0.45, 1e-12);
  EXPECT_NEAR(r.velocity_rad_s, std::numbers::pi * 0.5 * std::sqrt(3.0) / 2.0, 1e-12);
  EXPECT_NEAR(r.acceleration_rad_s2, -std::numbers::pi * std::numbers::pi * 0.25, 1e-12);
  EXPECT_EQ(reference_at(t, 0.5).angle_rad, 0.2);
  EXPECT_EQ(reference_at(t, 0.5).velocity_rad_s, 0.0);
}

TEST(ReferenceTrajectory, TableIsLinearBetweenRowsAndHeldAfterTheLast) {
  const std::array<Reference, 3> rows{{{0.0, 1.0, 2.0}, {1.0, 3.0, 4.0}, {2.0, 5.0, 6.0}}};
  ReferenceTrajectory t;
  t.kind = ReferenceKind::kTable;
  t.table = rows.data();
  t.samples = 3;
  t.sample_period_s = 0.01;
  EXPECT_NEAR(reference_at(t, 0.0025).angle_rad, 0.25, 1e-12);
  EXPECT_NEAR(reference_at(t, 0.0125).velocity_rad_s, 3.5, 1e-12);
  EXPECT_EQ(reference_at(t, 0.02).velocity_rad_s, 5.0);
  EXPECT_EQ(reference_at(t, 7.0).angle_rad, 2.0);
  EXPECT_EQ(reference_at(t, 7.0).velocity_rad_s, 0.0);
  EXPECT_EQ(reference_at(t, -1.0).angle_rad, 0.0);
}

TEST(ReferenceTrajectory, EmptyTableStandsStill) {
  ReferenceTrajectory t;
  t.kind = ReferenceKind::kTable;
  EXPECT_EQ(reference_at(t, 1.0).angle_rad, 0.0);
}

TEST(ReferenceTrajectory, ExternalSampleAsItIs) {
  ReferenceTrajectory t;
  t.kind = ReferenceKind::kExternal;
  t.external = {0.1, 0.2, 0.3};
  EXPECT_EQ(reference_at(t, 5.0).acceleration_rad_s2, 0.3);
}

TEST(ReferenceTrajectory, ClampTakesTheDerivativesWithIt) {
  Reference r{1.5, 2.0, 3.0};
  EXPECT_TRUE(clamp_reference(r, 1.0));
  EXPECT_EQ(r.angle_rad, 1.0);
  EXPECT_EQ(r.velocity_rad_s, 0.0);
  EXPECT_EQ(r.acceleration_rad_s2, 0.0);
  Reference inside{-1.0, 2.0, 3.0};
  EXPECT_FALSE(clamp_reference(inside, 1.0));
  EXPECT_EQ(inside.velocity_rad_s, 2.0);
  Reference broken{std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0};
  clamp_reference(broken, 1.0);
  EXPECT_TRUE(std::isnan(broken.angle_rad));
}

}  // namespace
}  // namespace eampc::control
