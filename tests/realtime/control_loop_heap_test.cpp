// The loop's thread must not touch the heap once it runs: operator new is counted per thread in
// this program.
#include <gtest/gtest.h>
#include <linux/can.h>
#include <sys/socket.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <thread>

#include "realtime/control_loop.hpp"
#include "realtime/toy_rig.hpp"

namespace {
thread_local std::int64_t allocations = 0;
}  // namespace

void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace eampc::realtime {
namespace {

TEST(ControlLoopHeap, IsNotUsedWhileTheLoopRuns) {
  constexpr int kFrames = 200;
  const control::ControllerConfig config = testing::toy_config(0.001);
  int ends[2];
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
  const FileDescriptor wire(ends[1]);
  Bus bus(CanBus(FileDescriptor(ends[0]), {testing::kEncoderId, false}));
  const auto loop = std::make_unique<ControlLoop>(bus, config, LoopSettings{.lockstep = true});
  LoopCommand arm;
  arm.id = 1;
  arm.action = control::OperatorAction::kArm;
  arm.at_cycle = 5;
  ASSERT_TRUE(loop->commands().push(arm));

  std::int64_t in_loop = -1;
  std::thread thread([&] {
    const std::int64_t before = allocations;
    loop->run();
    in_loop = allocations - before;
  });
  for (std::uint64_t i = 0; i < kFrames; ++i) {
    const control::Frame frame = control::encode_encoder_frame(config.encoder, 0.1, 0.0, i, 0);
    can_frame raw{};
    raw.can_id = frame.id;
    raw.can_dlc = frame.length;
    std::memcpy(raw.data, frame.data.data(), 8);
    ASSERT_EQ(::send(wire.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
    ASSERT_EQ(::recv(wire.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
  }
  loop->request_stop();
  thread.join();
  EXPECT_EQ(loop->counters().cycles, kFrames);
  EXPECT_EQ(in_loop, 0);
  const std::int64_t before = allocations;
  ::operator delete(::operator new(1));  // a direct call: an unused new-expression may be left out
  EXPECT_EQ(allocations, before + 1);    // the counter counts
}

}  // namespace
}  // namespace eampc::realtime
