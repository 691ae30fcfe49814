#include "control/control_cycle.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>
#include <type_traits>

#include "control/encoder_codec.hpp"
#include "control/reference_joint.hpp"
#include "control/valve_codec.hpp"

static_assert(std::is_trivially_copyable_v<eampc::control::CycleRecord>);
static_assert(std::is_trivially_copyable_v<eampc::control::Frame>);
static_assert(noexcept(std::declval<eampc::control::ControlCycle&>().step({})));

namespace eampc::control {
namespace {

// The linear model as plant, behind the frames of the bus.
class LinearJoint {
 public:
  explicit LinearJoint(const ControllerConfig& config) : config_(config) {}

  Frame frame() { return encode_encoder_frame(config_.encoder, x[0], x[1], counter++, 0); }

  void advance(const Frame& command, double d) {
    ValveVoltages v;
    ASSERT_TRUE(decode_valve_frame(config_.valve_command, command, v));
    const double u = v.enable ? (v.u1_V - v.u2_V) / (2.0 * config_.valve.control_gain_V) : 0.0;
    x = StateVector(config_.model.A_star * x + config_.model.B_star * u +
                    config_.model.D * MeasuredVector(0.0, d));
  }

  StateVector x = StateVector::Zero();
  std::uint64_t counter = 0;

 private:
  const ControllerConfig& config_;
};

// A bus that queues nothing.
CycleInput input_of(const Frame* encoder_frame) {
  CycleInput input;
  input.encoder_frame = encoder_frame;
  input.bus.queue_proved_empty = true;
  return input;
}

class ControlCycleTest : public testing::Test {
 protected:
  ControlCycleTest() {
    connect(joint_);
    joint_.config.safety.arming_ramp_s = 0.05;
    joint_.config.safety.soft_stop_ramp_s = 0.05;
    rebuild();
  }

  void rebuild() {
    plant_ = std::make_unique<LinearJoint>(joint_.config);
    cycle_ = std::make_unique<ControlCycle>(joint_.config);
  }

  CycleRecord step(OperatorAction action = OperatorAction::kNone, bool lost = false) {
    const Frame frame = plant_->frame();
    CycleInput input = input_of(lost ? nullptr : &frame);
    input.action = action;
    input.new_reference = reference_set_ ? nullptr : &reference_;
    reference_set_ = true;
    const CycleOutput output = cycle_->step(input);
    plant_->advance(output.command, disturbance_);
    return output.record;
  }

  void set_reference(double angle_rad) {
    reference_.amplitude_rad = angle_rad;
    reference_set_ = false;
  }

  ReferenceJoint joint_ = reference_joint();
  std::unique_ptr<LinearJoint> plant_;
  std::unique_ptr<ControlCycle> cycle_;
  ReferenceTrajectory reference_;
  bool reference_set_ = true;
  double disturbance_ = 0.0;
};

TEST_F(ControlCycleTest, ArmAtCycleTwentyIsActiveAfterItsRamp) {
  for (int k = 0; k < 40; ++k) {
    const CycleRecord record = step(k == 20 ? OperatorAction::kArm : OperatorAction::kNone);
    EXPECT_EQ(record.cycle, k);
    const Mode expected = k < 20 ? Mode::kDisarmed : k < 30 ? Mode::kArming : Mode::kActive;
    EXPECT_EQ(record.mode, expected) << k;
    if (k >= 30) {
      EXPECT_DOUBLE_EQ(record.scenario_time_s, (k - 30) * 0.005);
      EXPECT_EQ(record.law.region, 0);
    } else {
      EXPECT_LT(record.scenario_time_s, 0.0);
      EXPECT_EQ(record.law.region, -1);
      EXPECT_EQ(cycle_->at_rest(), k < 20);
    }
  }
}

TEST_F(ControlCycleTest, HoldsTheReferenceUnderALoadWithoutOffset) {
  set_reference(0.3);
  disturbance_ = 25.0;
  CycleRecord record;
  for (int k = 0; k < 1000; ++k)
    record = step(k == 5 ? OperatorAction::kArm : OperatorAction::kNone);
  EXPECT_EQ(record.mode, Mode::kActive);
  EXPECT_NEAR(plant_->x[0], 0.3, 2e-4);
  EXPECT_NEAR(record.disturbance.for_law[1], 25.0, 0.3);
}

TEST_F(ControlCycleTest, TheReferenceIsClampedAndReported) {
  set_reference(1.4);
  const CycleRecord record = step();
  EXPECT_EQ(record.reference.angle_rad, 1.0);
  EXPECT_TRUE(record.limits & kLimitReferenceRange);
}

TEST_F(ControlCycleTest, PaperWithAFixedReferenceReportsIt) {
  joint_.config.law.formulation = Formulation::kPaper;
  joint_.config.law.fixed_reference_rad = 0.5;
  rebuild();
  set_reference(0.1);
  EXPECT_EQ(step().reference.angle_rad, 0.5);
}

TEST_F(ControlCycleTest, ADuplicateIsNoPeriodButAFrozenEncoderIsAFault) {
  step();
  step(OperatorAction::kArm);
  for (int k = 0; k < 12; ++k) step();
  const Frame frame = plant_->frame();
  CycleInput input = input_of(&frame);
  const CycleRecord fresh = cycle_->step(input).record;
  const CycleRecord repeated = cycle_->step(input).record;
  EXPECT_EQ(repeated.sample.verdict, SampleVerdict::kDuplicate);
  EXPECT_EQ(repeated.cycle, fresh.cycle);
  EXPECT_EQ(repeated.scenario_time_s, fresh.scenario_time_s);
  EXPECT_EQ(repeated.law.u, fresh.law.u);
  CycleRecord frozen;
  for (int k = 0; k < 4; ++k) frozen = cycle_->step(input).record;
  EXPECT_EQ(frozen.fault, Fault::kEncoderFrozen);
}

TEST_F(ControlCycleTest, FramesLostOnTheBusMoveTimeOnByTheCounter) {
  joint_.config.safety.arming_ramp_s = 0.0;
  rebuild();
  step(OperatorAction::kArm);
  for (int k = 0; k < 5; ++k) step();
  plant_->counter += 2;
  const CycleRecord record = step();
  EXPECT_EQ(record.sample.missed_frames, 2u);
  EXPECT_DOUBLE_EQ(record.scenario_time_s, 8 * 0.005);
  EXPECT_EQ(record.cycle, 8);
}

TEST_F(ControlCycleTest, PeriodsReportedAsEmptyAreNotCountedTwice) {
  joint_.config.safety.arming_ramp_s = 0.0;
  rebuild();
  step(OperatorAction::kArm);
  for (int k = 0; k < 5; ++k) step();
  step(OperatorAction::kNone, true);
  step(OperatorAction::kNone, true);
  const CycleRecord record = step();
  EXPECT_EQ(record.sample.missed_frames, 2u);
  EXPECT_EQ(record.cycle, 8);
  EXPECT_DOUBLE_EQ(record.scenario_time_s, 8 * 0.005);
}

// A frame that came more than half a period late made an empty period and then its own: after each
// the reference was one period ahead of the encoder, 8 mrad on a 0.5 Hz sine.
TEST_F(ControlCycleTest, AFrameThatComesLateAfterItsEmptyPeriodDoesNotMoveTimeAgain) {
  for (int i = 0; i < 20; ++i) step();
  const std::int64_t before = step().cycle;
  CycleInput nothing;
  EXPECT_EQ(cycle_->step(nothing).record.cycle, before + 1);
  const CycleRecord late = step();  // the counter has no gap
  EXPECT_EQ(late.sample.missed_frames, 0u);
  EXPECT_EQ(late.cycle, before + 1);
  EXPECT_EQ(step().cycle, before + 2);

  // Two empty periods, then both frames in a burst.
  cycle_->step(nothing);
  EXPECT_EQ(cycle_->step(nothing).record.cycle, before + 4);
  EXPECT_EQ(step().cycle, before + 4);
  EXPECT_EQ(step().cycle, before + 4);
  EXPECT_EQ(step().cycle, before + 5);
}

TEST_F(ControlCycleTest, ALateFrameStillDecidesTheCommand) {
  step(OperatorAction::kArm);
  for (int i = 0; i < 100; ++i) step();
  CycleInput nothing;
  const CycleRecord empty = cycle_->step(nothing).record;
  ASSERT_EQ(empty.mode, Mode::kActive);
  plant_->x[0] += 0.02;  // what only the late measurement knows
  const CycleRecord late = step();
  EXPECT_EQ(late.cycle, empty.cycle);
  EXPECT_LT(late.valves.u1_V, empty.valves.u1_V - 0.05);
  EXPECT_GT(late.valves.u2_V, empty.valves.u2_V + 0.05);
}

TEST_F(ControlCycleTest, WithoutACounterEveryFrameIsAPeriod) {
  joint_.config.encoder.counter.present = false;
  rebuild();
  for (int i = 0; i < 20; ++i) step();
  const std::int64_t before = step().cycle;
  CycleInput nothing;
  cycle_->step(nothing);
  EXPECT_EQ(step().cycle, before + 2);
}

TEST_F(ControlCycleTest, ALostFrameIsBridgedByTheModel) {
  set_reference(0.2);
  disturbance_ = 10.0;
  for (int k = 0; k < 300; ++k) step(k == 0 ? OperatorAction::kArm : OperatorAction::kNone);
  for (int k = 0; k < 200; ++k) {
    const CycleRecord record = step(OperatorAction::kNone, k % 3 == 1);
    EXPECT_EQ(record.mode, Mode::kActive);
    EXPECT_NEAR(record.state.x[0], 0.2, 1e-3);
    EXPECT_NEAR(record.disturbance.for_law[1], 10.0, 0.5);
  }
}

TEST_F(ControlCycleTest, ARefusedCommandIsNotBelievedToActOnTheValves) {
  joint_.config.safety.arming_ramp_s = 0.0;
  rebuild();
  set_reference(0.0);
  step(OperatorAction::kArm);
  step();
  set_reference(0.1);  // a jump of the control in this command, which the bus then refuses
  const Frame first = plant_->frame();
  CycleInput input = input_of(&first);
  input.new_reference = &reference_;
  const CycleRecord jump = cycle_->step(input).record;
  EXPECT_GT(std::abs(jump.law.u), 1.0);
  const Frame second = plant_->frame();
  input = input_of(&second);
  input.bus.send_refused = true;
  EXPECT_EQ(cycle_->step(input).record.state.x[2],
            jump.state.x[2] * joint_.config.model.A_star(2, 2));
}

// Whatever the bus brings, one decodable frame goes out per step, in the box, in the slew limit
// after rounding.
TEST_F(ControlCycleTest, RandomFramesNeverLeaveBoxOrSlewOnTheWire) {
  constexpr int kSteps = 200'000;
  joint_.config.valve.slew_max_V_per_s = 250.0;  // 1.25 V per period
  joint_.config.valve.min_V = 0.0004;            // off the grid of 1 mV, as is the upper bound
  joint_.config.valve.max_V = 9.9996;
  joint_.config.valve.safe_V = 0.0004;
  joint_.config.valve_command.u1.factor = 0.007;
  joint_.config.safety.arming_ramp_s = 0.0;
  rebuild();
  std::mt19937_64 random(5);
  ValveVoltages last{0.0, 0.0, false};
  int active = 0;
  for (int k = 0; k < kSteps; ++k) {
    Frame frame = encode_encoder_frame(
        joint_.config.encoder, std::uniform_real_distribution<>(-2.0, 2.0)(random),
        std::uniform_real_distribution<>(-20.0, 20.0)(random), random(), 0);
    if (random() % 20 == 0)
      frame.data[random() % 8] ^= static_cast<std::uint8_t>(1u << (random() % 8));
    if (random() % 50 == 0) frame.length = static_cast<std::uint8_t>(random() % 9);
    CycleInput input = input_of(random() % 10 == 0 ? nullptr : &frame);
    input.action = static_cast<OperatorAction>(random() % 200 == 0 ? random() % 4 : 0);
    if (random() % 20 == 0)
      input.action = random() % 2 == 0 ? OperatorAction::kArm : OperatorAction::kReset;
    const CycleOutput output = cycle_->step(input);
    ValveVoltages v;
    ASSERT_TRUE(decode_valve_frame(joint_.config.valve_command, output.command, v));
    ASSERT_EQ(v.enable, output.record.valves.enable);
    ASSERT_GE(std::min(v.u1_V, v.u2_V), 0.0004 - 1e-9);
    ASSERT_LE(std::max(v.u1_V, v.u2_V), 9.9996 + 1e-9);
    if (v.enable && last.enable) {
      ASSERT_LE(std::abs(v.u1_V - last.u1_V), 1.25 + 1e-9);
      ASSERT_LE(std::abs(v.u2_V - last.u2_V), 1.25 + 1e-9);
    }
    active += output.record.mode == Mode::kActive;
    last = v;
  }
  EXPECT_GT(active, 1000);
}

}  // namespace
}  // namespace eampc::control
