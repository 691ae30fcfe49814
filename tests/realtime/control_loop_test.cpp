// The real loop on a socketpair. No absolute time is judged: periods are long, counts are compared.
#include "realtime/control_loop.hpp"

#include <gtest/gtest.h>
#include <linux/can.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/socket.h>
#include <time.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "control/frame_codec.hpp"
#include "realtime/toy_rig.hpp"

namespace eampc::realtime {
namespace {

using control::Mode;
using control::OperatorAction;
using std::chrono::milliseconds;

// Holds a thread in a signal handler, as a scheduler does that gives it no time.
class StarvedThread {
 public:
  explicit StarvedThread(std::thread& thread) {
    released_ = false;
    held_ = false;
    struct sigaction action {};
    action.sa_handler = hold;
    EXPECT_EQ(::sigaction(SIGUSR1, &action, nullptr), 0);
    EXPECT_EQ(::pthread_kill(thread.native_handle(), SIGUSR1), 0);
    while (!held_) pause();
  }
  ~StarvedThread() { released_ = true; }
  StarvedThread(const StarvedThread&) = delete;
  StarvedThread& operator=(const StarvedThread&) = delete;

 private:
  static void pause() {
    const timespec limit{0, 1'000'000};
    ::clock_nanosleep(CLOCK_MONOTONIC, 0, &limit, nullptr);  // one of the loop's own calls
  }
  static void hold(int) {
    held_ = true;
    while (!released_) pause();
  }
  static inline std::atomic<bool> held_{false};
  static inline std::atomic<bool> released_{false};
};

class ControlLoopTest : public ::testing::Test {
 protected:
  void open(double period_s, bool lockstep, bool sync = false) {
    config_ = testing::toy_config(period_s);
    config_.trigger_on_sync = sync;
    int ends[2];
    ASSERT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
    wire_ = FileDescriptor(ends[1]);
    bus_.emplace(CanBus(FileDescriptor(ends[0]), {testing::kEncoderId, false}));
    loop_ = std::make_unique<ControlLoop>(*bus_, config_, LoopSettings{.lockstep = lockstep});
  }
  void start() {
    thread_ = std::thread([this] { loop_->run(); });
  }
  void stop() {
    loop_->request_stop();
    if (thread_.joinable()) thread_.join();
  }
  void TearDown() override {
    if (loop_) stop();
  }

  void put_encoder(double angle_rad = 0.0) {
    put(control::encode_encoder_frame(config_.encoder, angle_rad, 0.0, counter_++, 0));
  }
  void put(const control::Frame& frame) {
    can_frame raw{};
    raw.can_id = frame.id;
    raw.can_dlc = frame.length;
    std::memcpy(raw.data, frame.data.data(), 8);
    ASSERT_EQ(::send(wire_.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
  }
  std::optional<control::Frame> next(milliseconds limit) {
    pollfd descriptor{wire_.get(), POLLIN, 0};
    if (::poll(&descriptor, 1, static_cast<int>(limit.count())) <= 0) return std::nullopt;
    can_frame raw{};
    if (::recv(wire_.get(), &raw, sizeof raw, 0) != static_cast<ssize_t>(sizeof raw))
      return std::nullopt;
    control::Frame frame;
    frame.id = raw.can_id;
    frame.length = raw.can_dlc;
    std::memcpy(frame.data.data(), raw.data, 8);
    return frame;
  }
  control::Frame command() {
    const auto frame = next(milliseconds(10'000));
    EXPECT_TRUE(frame);
    if (!frame) return {};
    EXPECT_EQ(frame->id, testing::kCommandId);
    return *frame;
  }
  std::vector<LoopRecord> records() {
    std::vector<LoopRecord> all;
    LoopRecord record;
    while (loop_->records().pop(record)) all.push_back(record);
    return all;
  }
  void order(OperatorAction action, std::int64_t at_cycle) {
    LoopCommand command;
    command.id = ++last_id_;
    command.action = action;
    command.at_cycle = at_cycle;
    ASSERT_TRUE(loop_->commands().push(command));
  }

  control::ControllerConfig config_;
  FileDescriptor wire_;
  std::optional<Bus> bus_;
  std::unique_ptr<ControlLoop> loop_;
  std::thread thread_;
  std::uint64_t counter_ = 0;
  std::uint64_t last_id_ = 0;
};

TEST_F(ControlLoopTest, LockstepAnswersEveryFrameEvenWhenTheyQueue) {
  open(0.001, true);
  for (int i = 0; i < 50; ++i) put_encoder();
  start();
  for (int i = 0; i < 50; ++i) command();
  stop();
  const auto all = records();
  ASSERT_EQ(all.size(), 50u);
  for (std::size_t i = 0; i < all.size(); ++i)
    EXPECT_EQ(all[i].cycle.cycle, static_cast<std::int64_t>(i));
  EXPECT_EQ(loop_->counters().encoder_frames, 50);
  EXPECT_EQ(loop_->counters().missed_cycles(), 0);
}

TEST_F(ControlLoopTest, LockstepHasNoClock) {
  open(0.001, true);
  start();
  put_encoder();
  command();
  EXPECT_FALSE(next(milliseconds(50)));  // 50 periods without a frame: no cycle
  put_encoder();
  command();
  stop();
  EXPECT_EQ(loop_->counters().cycles, 2);
}

TEST_F(ControlLoopTest, CommandsActInExactlyTheirCycle) {
  open(0.001, true);
  order(OperatorAction::kDisarm, 30);
  order(OperatorAction::kArm, 10);
  for (int i = 0; i < 50; ++i) put_encoder();
  start();
  for (int i = 0; i < 50; ++i) command();
  stop();
  const auto all = records();
  ASSERT_EQ(all.size(), 50u);
  EXPECT_EQ(all[9].cycle.mode, Mode::kDisarmed);
  EXPECT_EQ(all[10].cycle.mode, Mode::kActive);  // no arming ramp in the toy rig
  EXPECT_EQ(all[10].cycle.scenario_time_s, 0.0);
  EXPECT_EQ(all[29].cycle.mode, Mode::kActive);
  EXPECT_EQ(all[30].cycle.mode, Mode::kSoftStop);
  EXPECT_EQ(all[49].cycle.mode, Mode::kDisarmed);
}

TEST_F(ControlLoopTest, DisarmWinsOverEveryArmThatWaits) {
  open(0.001, true);
  order(OperatorAction::kArm, 5);
  order(OperatorAction::kArm, -1);
  order(OperatorAction::kDisarm, -1);
  for (int i = 0; i < 10; ++i) put_encoder();
  start();
  for (int i = 0; i < 10; ++i) command();
  stop();
  for (const LoopRecord& record : records()) EXPECT_EQ(record.cycle.mode, Mode::kDisarmed);
  EXPECT_EQ(loop_->newest().executed_command, 3u);
}

TEST_F(ControlLoopTest, AFaultCancelsTheArmingThatWasScheduled) {
  open(0.001, true);
  order(OperatorAction::kArm, 5);
  order(OperatorAction::kReset, 300);
  order(OperatorAction::kArm, 350);
  for (int i = 0; i < 400; ++i) {
    control::Frame frame = control::encode_encoder_frame(config_.encoder, 0.0, 0.0, counter_++, 0);
    if (i >= 20 && i < 100) frame.length = 1;
    put(frame);
    if (i == 0) start();
    command();
  }
  stop();
  const auto all = records();
  ASSERT_EQ(all.size(), 400u);
  EXPECT_EQ(all[10].cycle.mode, Mode::kActive);
  EXPECT_EQ(all[290].cycle.mode, Mode::kFault);
  for (std::size_t i = 300; i < 400; ++i) EXPECT_EQ(all[i].cycle.mode, Mode::kDisarmed) << i;
}

TEST_F(ControlLoopTest, AReplacedTableGoesBackToItsOwner) {
  open(0.001, true);
  const std::vector<control::Reference> first(3), second(3);
  for (const auto* table : {&first, &second}) {
    LoopCommand command;
    command.id = ++last_id_;
    command.at_cycle = table == &first ? 1 : 3;
    command.has_reference = true;
    command.reference.kind = control::ReferenceKind::kTable;
    command.reference.table = table->data();
    command.reference.samples = 3;
    command.reference.sample_period_s = 0.1;
    ASSERT_TRUE(loop_->commands().push(command));
  }
  for (int i = 0; i < 5; ++i) put_encoder();
  start();
  for (int i = 0; i < 5; ++i) command();
  stop();
  const control::Reference* released = nullptr;
  ASSERT_TRUE(loop_->released_tables().pop(released));
  EXPECT_EQ(released, first.data());
  EXPECT_FALSE(loop_->released_tables().pop(released));
}

TEST_F(ControlLoopTest, RealTimeUsesTheNewestOfSeveralFrames) {
  open(0.2, false);
  put_encoder(0.1);
  put_encoder(0.2);
  put_encoder(0.3);
  start();
  command();
  stop();
  const auto all = records();
  ASSERT_EQ(all.size(), 1u);
  EXPECT_NEAR(all[0].cycle.sample.angle_rad, 0.3, 1e-4);
  EXPECT_EQ(loop_->counters().superseded_frames, 2);
}

TEST_F(ControlLoopTest, APeriodWithoutAFrameStillSendsOneCommand) {
  open(0.02, false);
  start();
  EXPECT_FALSE(next(milliseconds(100)));  // nothing before the first frame
  put_encoder();
  command();
  command();  // 1.5 periods later, without a frame
  command();
  stop();
  const auto all = records();
  ASSERT_GE(all.size(), 3u);
  EXPECT_TRUE(all[0].frame_seen);
  EXPECT_FALSE(all[1].frame_seen);
  EXPECT_EQ(all[1].cycle.cycle, 1);
  EXPECT_GE(loop_->counters().encoder_timeouts, 2);
}

TEST_F(ControlLoopTest, ALateFrameDoesNotMakeASecondCycleInItsPeriod) {
  open(0.4, false);
  start();
  put_encoder();
  command();
  command();      // the period is given up at 0.6 s
  put_encoder();  // now, less than half a period after
  EXPECT_FALSE(next(milliseconds(100)));
  stop();
  EXPECT_EQ(loop_->counters().late_frames, 1);
}

// One lost frame must not cost the next one, whatever the adapter's jitter: it comes half a period
// after the lost one was given up, minus or plus.
TEST_F(ControlLoopTest, TheFrameAfterALostOneIsNotLate) {
  open(0.4, false);
  start();
  put_encoder();
  command();
  ++counter_;  // lost on the bus
  command();   // given up at 0.6 s
  std::this_thread::sleep_for(milliseconds(150));
  put_encoder();  // 0.75 s: 50 ms before its instant
  EXPECT_TRUE(next(milliseconds(100)));
  stop();
  EXPECT_EQ(loop_->counters().late_frames, 0);
  EXPECT_EQ(loop_->counters().valid_frames, 2);
}

TEST_F(ControlLoopTest, StopRampsDownAndSendsTheSafeFrameLast) {
  open(0.001, true);
  order(OperatorAction::kArm, 1);
  start();
  control::Frame last;
  for (int i = 0; i < 5; ++i) {
    put_encoder();
    last = command();
  }
  EXPECT_EQ(control::extract_bits(last.data, config_.valve_command.enable), 1u);
  stop();
  last = command();
  EXPECT_EQ(control::extract_bits(last.data, config_.valve_command.enable), 0u);
  EXPECT_EQ(control::extract_bits(last.data, config_.valve_command.u1), 0u);
  EXPECT_FALSE(next(milliseconds(0)));
  EXPECT_TRUE(loop_->newest().at_rest);
}

// A fault that holds the voltages first takes three ramps to come to rest.
TEST_F(ControlLoopTest, StopEndsALongHoldToo) {
  open(0.001, true);
  config_.safety.actions[control::Fault::kEncoderTimeout] = control::StopAction::kSaturate;
  config_.safety.encoder_timeout_s = 0.001;
  config_.safety.soft_stop_ramp_s = 5.0;
  loop_ = std::make_unique<ControlLoop>(*bus_, config_, LoopSettings{.lockstep = true});
  order(OperatorAction::kArm, 1);
  start();
  put_encoder();
  command();
  put_encoder();
  EXPECT_EQ(control::extract_bits(command().data, config_.valve_command.enable), 1u);
  stop();
  EXPECT_EQ(control::extract_bits(command().data, config_.valve_command.enable), 0u);
  EXPECT_TRUE(loop_->newest().at_rest);
}

TEST_F(ControlLoopTest, SyncGoesOutOnAGridAndTheAnswerStartsTheCycle) {
  open(0.02, false, true);
  start();
  for (std::uint64_t i = 0; i < 5; ++i) {
    const auto sync = next(milliseconds(10'000));
    ASSERT_TRUE(sync);
    ASSERT_EQ(sync->id, testing::kSyncId);
    EXPECT_EQ(sync->data[0], i);
    EXPECT_EQ(sync->length, 1);
    put_encoder();
    command();
  }
  stop();
  EXPECT_EQ(loop_->counters().cycles, 5);
}

// The counter of four bits stands where it stood, or one further, or no frame waits.
TEST(StarvedCycle, SeesAnEncoderTimeoutWhateverTheCounterSays) {
  const control::ControllerConfig config = testing::toy_config(0.001);
  for (const std::uint64_t advance : {0u, 16u, 17u}) {
    control::ControlCycle cycle(config);
    control::CycleInput input;
    input.bus.queue_proved_empty = true;
    std::uint64_t counter = 0;
    const auto step = [&](std::uint64_t by) {
      counter += by;
      const auto frame = control::encode_encoder_frame(config.encoder, 0.0, 0.0, counter, 0);
      input.encoder_frame = by > 0 ? &frame : nullptr;
      return cycle.step(input).record;
    };
    step(1);
    input.action = OperatorAction::kArm;
    step(1);
    input.action = OperatorAction::kNone;
    const control::CycleRecord before = step(1);
    ASSERT_EQ(before.mode, Mode::kActive);
    input.starved_periods = 20;
    const control::CycleRecord after = step(advance);
    EXPECT_EQ(after.fault, control::Fault::kEncoderTimeout) << advance;
    EXPECT_NE(after.mode, Mode::kActive) << advance;
    EXPECT_EQ(after.cycle, before.cycle + 21) << advance;
  }
}

TEST_F(ControlLoopTest, AStarvedThreadDoesNotResume) {
  for (const int frames : {16, 17}) {
    open(0.02, false);
    config_.safety.encoder_timeout_s = 0.2;
    config_.safety.soft_stop_ramp_s = 0.0;
    loop_ = std::make_unique<ControlLoop>(*bus_, config_, LoopSettings{});
    order(OperatorAction::kArm, 1);
    start();
    bool enabled = false;
    for (int i = 0; i < 100 && !enabled; ++i) {
      put_encoder();
      enabled = control::extract_bits(command().data, config_.valve_command.enable) != 0;
      std::this_thread::sleep_for(milliseconds(18));
    }
    ASSERT_TRUE(enabled);
    {
      const StarvedThread starved(thread_);
      for (int i = 0; i < frames; ++i) put_encoder();
      std::this_thread::sleep_for(milliseconds(300));
      while (next(milliseconds(0))) {
      }
    }
    EXPECT_EQ(control::extract_bits(command().data, config_.valve_command.enable), 0u);
    for (int i = 0; i < 5; ++i) {
      put_encoder();
      EXPECT_EQ(control::extract_bits(command().data, config_.valve_command.enable), 0u);
    }
    const LoopRecord newest = loop_->newest();
    EXPECT_EQ(newest.cycle.fault, control::Fault::kEncoderTimeout);
    EXPECT_EQ(newest.cycle.mode, Mode::kFault);
    EXPECT_GE(loop_->counters().superseded_frames, frames - 1);
    EXPECT_GE(loop_->counters().deadline_overruns, 10);
    stop();
  }
}

TEST_F(ControlLoopTest, AVanishedBusIsCountedAndDoesNotSpin) {
  open(0.005, false);
  start();
  put_encoder();
  command();
  wire_.reset();
  std::this_thread::sleep_for(milliseconds(100));
  stop();
  EXPECT_GE(loop_->counters().send_errors, 2);
}

}  // namespace
}  // namespace eampc::realtime
