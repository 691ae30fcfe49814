// The loop's thread must not touch the heap once it runs. operator new and, through the linker
// (--wrap), every malloc that our own objects and Eigen's templates in them ask for are counted per
// thread in this program.
#include <gtest/gtest.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <sys/socket.h>

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <thread>

#include "realtime/control_loop.hpp"
#include "realtime/toy_rig.hpp"

namespace {
// Volatile: the compiler knows that malloc changes no variable of ours.
thread_local volatile std::int64_t allocations = 0;
void count_allocation() noexcept { allocations = allocations + 1; }
}  // namespace

extern "C" {
void* __real_malloc(std::size_t size);
void* __real_calloc(std::size_t count, std::size_t size);
void* __real_realloc(void* memory, std::size_t size);
int __real_posix_memalign(void** memory, std::size_t alignment, std::size_t size);
void* __wrap_malloc(std::size_t size) {
  count_allocation();
  return __real_malloc(size);
}
void* __wrap_calloc(std::size_t count, std::size_t size) {
  count_allocation();
  return __real_calloc(count, size);
}
void* __wrap_realloc(void* memory, std::size_t size) {
  count_allocation();
  return __real_realloc(memory, size);
}
int __wrap_posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  count_allocation();
  return __real_posix_memalign(memory, alignment, size);
}
}

void* operator new(std::size_t size) {
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace eampc::realtime {
namespace {

constexpr int kBlock = 50;  // frames that wait in the socket at once
constexpr int kBlocks = 2000;

// An encoder, an operator and a bus with everything that goes wrong on it, in turns of one block.
class Story {
 public:
  Story(const control::ControllerConfig& config, ControlLoop& loop, int wire)
      : config_(config), loop_(loop), wire_(wire) {}

  void play(int block) {
    switch (block % 8) {
      case 0:
        command(control::OperatorAction::kReset);
        command(control::OperatorAction::kArm);
        return frames(kBlock);
      case 1:
        follow(control::ReferenceKind::kSine);
        return frames(kBlock);
      case 2:
        follow(control::ReferenceKind::kTable);
        return frames(kBlock);
      case 3:
        follow(control::ReferenceKind::kExternal);
        return frames(kBlock);
      case 4:  // a counter gap, a controller in trouble
        counter_ += 3;
        error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE);
        return frames(kBlock);
      case 5:
        command(control::OperatorAction::kReset);
        command(control::OperatorAction::kArm);
        return frames(kBlock);
      case 6:  // longer than safety.encoder_timeout_s
        return frames(kBlock, 5);
      default:
        error_frame(CAN_ERR_BUSOFF, 0);
        error_frame(CAN_ERR_RESTARTED, 0);
        command(control::OperatorAction::kDisarm);
        return frames(kBlock);
    }
  }

 private:
  void command(control::OperatorAction action) {
    LoopCommand command;
    command.id = ++command_id_;
    command.action = action;
    ASSERT_TRUE(loop_.commands().push(command));
  }
  void follow(control::ReferenceKind kind) {
    LoopCommand command;
    command.id = ++command_id_;
    command.has_reference = true;
    command.reference.kind = kind;
    command.reference.amplitude_rad = 0.1;
    command.reference.frequency_hz = 2.0;
    command.reference.external = {0.1, 0.2, 0.3};
    command.reference.table = kind == control::ReferenceKind::kTable ? table_.data() : nullptr;
    command.reference.samples = static_cast<std::int32_t>(table_.size());
    command.reference.sample_period_s = 0.01;
    ASSERT_TRUE(loop_.commands().push(command));
  }
  void put(const can_frame& raw) {
    ASSERT_EQ(::send(wire_, &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
  }
  void error_frame(canid_t kind, std::uint8_t detail) {
    can_frame raw{};
    raw.can_id = CAN_ERR_FLAG | kind;
    raw.can_dlc = CAN_ERR_DLC;
    raw.data[1] = detail;
    put(raw);
  }
  void frames(int count, std::uint8_t length = 8) {
    for (int i = 0; i < count; ++i) {
      const double angle_rad = 0.05 * std::sin(0.01 * static_cast<double>(counter_));
      const control::Frame frame =
          control::encode_encoder_frame(config_.encoder, angle_rad, 0.0, counter_++, 0);
      can_frame raw{};
      raw.can_id = frame.id;
      raw.can_dlc = length;
      std::memcpy(raw.data, frame.data.data(), 8);
      put(raw);
    }
    for (int i = 0; i < count; ++i) {
      can_frame raw{};
      ASSERT_EQ(::recv(wire_, &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
    }
  }

  const control::ControllerConfig& config_;
  ControlLoop& loop_;
  const int wire_;
  std::uint64_t counter_ = 0;
  std::uint64_t command_id_ = 0;
  std::array<control::Reference, 3> table_{{{0.0, 0.0, 0.0}, {0.1, 1.0, 0.0}, {0.2, 0.0, 0.0}}};
};

// What the service threads do meanwhile: records out, tables back, status read.
struct Telemetry {
  std::int64_t records = 0, active = 0, with_fault = 0, tables = 0;

  void read(ControlLoop& loop) {
    LoopRecord record;
    while (loop.records().pop(record)) {
      ++records;
      active += record.cycle.mode == control::Mode::kActive ? 1 : 0;
      with_fault += record.cycle.fault != control::Fault::kNone ? 1 : 0;
    }
    const control::Reference* table = nullptr;
    while (loop.released_tables().pop(table)) ++tables;
    EXPECT_LE(loop.newest().cycle.cycle, kBlock * kBlocks + 16 * kBlocks);
  }
};

TEST(ControlLoopHeap, IsNotUsedWhileTheLoopRuns) {
  control::ControllerConfig config = testing::toy_config(0.001);
  config.safety.arming_ramp_s = 0.005;
  int ends[2];
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
  const FileDescriptor wire(ends[1]);
  Bus bus(CanBus(FileDescriptor(ends[0]), {.encoder = {testing::kEncoderId, false}}));
  const auto loop = std::make_unique<ControlLoop>(bus, config, LoopSettings{.lockstep = true});

  std::int64_t in_loop = -1;
  std::thread thread([&] {
    const std::int64_t before = allocations;
    loop->run();
    in_loop = allocations - before;
  });
  Telemetry telemetry;
  Story story(config, *loop, wire.get());
  for (int block = 0; block < kBlocks; ++block) {
    ASSERT_NO_FATAL_FAILURE(story.play(block));
    telemetry.read(*loop);
  }
  loop->request_stop();
  thread.join();
  telemetry.read(*loop);

  constexpr std::int64_t kFrames = std::int64_t{kBlock} * kBlocks;
  EXPECT_EQ(loop->counters().cycles, kFrames);
  EXPECT_EQ(telemetry.records, kFrames);
  EXPECT_GT(telemetry.active, kFrames / 4);
  EXPECT_GT(telemetry.with_fault, kFrames / 10);
  EXPECT_GT(telemetry.tables, kBlocks / 16);
  EXPECT_EQ(in_loop, 0);
}

// RealtimeSanitizer's own allocator stands before --wrap and reports every call by itself.
#ifndef EAMPC_SANITIZE_realtime
// The counters count: without this the test above proves nothing.
TEST(ControlLoopHeap, EveryWayToTheHeapIsCounted) {
  const auto counted = [](auto&& allocate) {
    const std::int64_t before = allocations;
    allocate();
    return allocations - before;
  };
  EXPECT_EQ(counted([] { ::operator delete(::operator new(1)); }), 1);
  // Through a volatile pointer: memory that nobody looks at may be left out by the compiler.
  void* volatile seen = nullptr;
  volatile std::size_t size = 3;
  EXPECT_EQ(counted([&] {
              seen = std::malloc(size);
              std::free(seen);
            }),
            1);
  EXPECT_EQ(counted([&] {
              seen = std::calloc(size, size);
              std::free(seen);
            }),
            1);
  EXPECT_EQ(counted([&] {
              Eigen::VectorXd vector(static_cast<Eigen::Index>(size));
              seen = vector.data();
            }),
            1);
}
#endif

}  // namespace
}  // namespace eampc::realtime
