// Anything on the bus, anything from the operator, for 300,000 periods: what must hold always, told
// from the frames and records alone.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "control/matrix_bench.hpp"

namespace eampc::control {
namespace {

bool rests(Mode mode) {
  return mode == Mode::kInit || mode == Mode::kDisarmed || mode == Mode::kFault;
}

// The arrows of the state diagram, each with what it takes. Several may lie in one cycle: armed
// without a ramp, or stopped by a cause found in the cycle that began ACTIVE.
bool is_allowed(Mode from, Mode to, OperatorAction action, Fault fault) {
  if (from == to) return true;
  const bool arms = action == OperatorAction::kArm;
  const bool faulty = fault != Fault::kNone;
  switch (to) {
    case Mode::kInit:
      return false;
    case Mode::kDisarmed:
      return from == Mode::kInit || (from == Mode::kSoftStop && !faulty) ||
             (from == Mode::kFault && action == OperatorAction::kReset);
    case Mode::kArming:
      return arms && (from == Mode::kInit || from == Mode::kDisarmed ||
                      (from == Mode::kSoftStop && !faulty));
    case Mode::kActive:
      return from == Mode::kArming;
    case Mode::kSoftStop:
      return (from == Mode::kArming || from == Mode::kActive) &&
             (faulty || action == OperatorAction::kDisarm);
    case Mode::kFault:
      return faulty && !(from == Mode::kInit);
  }
  return false;
}

class SafetyPropertyTest : public testing::TestWithParam<unsigned> {};

TEST_P(SafetyPropertyTest, WhateverComes) {
  constexpr int kPeriods = 60'000;
  std::mt19937_64 random(GetParam());
  const auto one_in = [&](unsigned n) { return random() % n == 0; };
  ReferenceJoint joint = monitored_joint();
  ControllerConfig& config = joint.config;
  for (std::size_t number = 1; number < kFaultCount; ++number) {
    config.safety.actions.of[number] = static_cast<StopAction>(random() % 4);
  }
  ControlCycle cycle(config);
  std::uint64_t counter = 0;
  double angle_rad = 0.0;
  bool storm = false;  // calm times let the machine arm, storms throw everything at it
  ValveVoltages last;
  CycleRecord before;
  int active = 0;
  int faults = 0;
  for (int k = 0; k < kPeriods; ++k) {
    if (one_in(200)) storm = !storm && one_in(2);
    angle_rad += 0.002 * (static_cast<double>(random() % 3) - 1.0);
    Frame frame = encode_encoder_frame(
        config.encoder,
        storm && one_in(20) ? 40.0 * (static_cast<double>(random() % 100) / 100.0 - 0.5)
                            : angle_rad,
        0.01 * static_cast<double>(random() % 100), counter++, storm && one_in(50) ? random() : 0);
    if (storm && one_in(10)) frame.data[random() % 8] ^= static_cast<std::uint8_t>(random());
    if (storm && one_in(20)) frame.length = static_cast<std::uint8_t>(random() % 9);
    if (storm && one_in(20)) frame.remote = true;
    if (storm && one_in(20)) counter += random() % 16;

    Frame told;
    told.length = 8;
    told.id = 0x182;
    told.data[4] = 0x10;
    told.data[5] = 0x27;
    cycle.observe(told);
    told = {};
    told.id = 0x701;
    told.length = 1;
    told.data[0] = 5;
    if (k % 5 == 0) cycle.observe(told);
    while (storm && one_in(3)) {
      constexpr std::uint32_t kIds[] = {0x182, 0x701, 0x81, 0x10, 0x281, 0x181, 0x7FF};
      told.id = kIds[random() % 7];
      told.length = static_cast<std::uint8_t>(random() % 9);
      for (auto& byte : told.data) byte = static_cast<std::uint8_t>(random());
      cycle.observe(told);
    }
    if (!storm && k % 20 == 0) {  // whoever raised an alarm takes it back
      for (const std::uint32_t id : {0x81u, 0x10u, 0x281u}) {
        told = {};
        told.id = id;
        told.length = id == 0x81 ? 8 : id == 0x10 ? 1 : 4;
        if (id == 0x281) told.data = {0x00, 0xEE, 0xFF, 0xC0};
        cycle.observe(told);
      }
    }

    CycleInput input;
    input.encoder_frame = storm && one_in(10) ? nullptr : &frame;
    input.bus.queue_proved_empty = !storm || !one_in(5);
    if (storm) {
      input.bus.link_down = one_in(300);
      input.bus.bus_off = one_in(300);
      input.bus.error_passive = one_in(3);
      input.bus.send_refused = one_in(20);
      input.bus.unconfirmed_periods = one_in(50) ? static_cast<std::int32_t>(random() % 5) : 0;
      input.bus.deadline_overruns = one_in(10) ? static_cast<std::int32_t>(random() % 9) : 0;
    }
    ReferenceTrajectory reference;
    if (one_in(100)) {
      reference.amplitude_rad = storm && one_in(2) ? std::numeric_limits<double>::quiet_NaN()
                                                   : 0.01 * static_cast<double>(random() % 200);
      input.new_reference = &reference;
    }
    input.action =
        one_in(15) ? static_cast<OperatorAction>(1 + random() % 3) : OperatorAction::kNone;
    if (one_in(8) && before.mode == Mode::kFault) input.action = OperatorAction::kReset;
    if (input.action == OperatorAction::kDisarm && !one_in(5)) input.action = OperatorAction::kArm;

    const CycleOutput output = cycle.step(input);
    const CycleRecord& now = output.record;
    ValveVoltages v;
    ASSERT_TRUE(decode_valve_frame(config.valve_command, output.command, v));
    ASSERT_TRUE(std::isfinite(v.u1_V) && std::isfinite(v.u2_V));
    ASSERT_TRUE(v.u1_V >= 0.0 && v.u1_V <= 10.0 && v.u2_V >= 0.0 && v.u2_V <= 10.0);
    ASSERT_EQ(v.enable, !rests(now.mode));
    if (v.enable) {
      const double slew_V = (now.limits & kLimitReduced) != 0 ? 0.5 : 1.5;
      ASSERT_LE(std::abs(v.u1_V - last.u1_V), slew_V + 1e-9);
      ASSERT_LE(std::abs(v.u2_V - last.u2_V), slew_V + 1e-9);
    } else {
      ASSERT_TRUE(v.u1_V == 0.0 && v.u2_V == 0.0);
    }
    ASSERT_TRUE(is_allowed(before.mode, now.mode, input.action, now.fault))
        << mode_text(before.mode) << " to " << mode_text(now.mode) << " in period " << k;
    // Latched: a fault goes by a reset out of FAULT only, and comes in motion only.
    if (before.fault != Fault::kNone && now.fault != before.fault) {
      // The reset may come in the very cycle in which the stop is over.
      ASSERT_TRUE(before.mode == Mode::kFault || before.mode == Mode::kSoftStop);
      ASSERT_EQ(input.action, OperatorAction::kReset);
      ASSERT_EQ(now.fault, Fault::kNone);
      ASSERT_FALSE(now.present_faults.has(before.fault));
    }
    if (before.fault == Fault::kNone && now.fault != Fault::kNone) {
      ASSERT_TRUE(now.present_faults.has(now.fault)) << fault_name(now.fault);
      ASSERT_FALSE(rests(before.mode) && input.action != OperatorAction::kArm);
      ++faults;
    }
    // In motion no cause is left without its stop, and an immediate one leaves no motion.
    if (!rests(now.mode) && now.fault == Fault::kNone) {
      ASSERT_TRUE(now.present_faults.empty() || rests(before.mode)) << now.present_faults.bits();
    }
    for (std::size_t number = 1; number < kFaultCount; ++number) {
      const auto fault = static_cast<Fault>(number);
      if (now.present_faults.has(fault) && !rests(before.mode) &&
          config.safety.actions[fault] == StopAction::kImmediate) {
        ASSERT_TRUE(rests(now.mode)) << fault_name(fault);
      }
    }
    // Up only with everything proved.
    if (now.mode == Mode::kArming && before.mode != Mode::kArming) {
      ASSERT_TRUE(now.present_faults.empty() && input.bus.queue_proved_empty);
      ASSERT_EQ(now.refusal, Refusal::kNone);
    }
    active += now.mode == Mode::kActive;
    last = v;
    before = now;
  }
  EXPECT_GT(active, kPeriods / 100);
  EXPECT_GT(faults, 20);
}

INSTANTIATE_TEST_SUITE_P(Seeds, SafetyPropertyTest, testing::Range(1u, 6u));

}  // namespace
}  // namespace eampc::control
