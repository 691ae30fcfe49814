#include "realtime/snapshot.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace eampc::realtime {
namespace {

TEST(Snapshot, NeverGivesHalfOfOneValueAndHalfOfAnother) {
  struct Value {
    std::array<std::uint64_t, 33> words{};
  };
  Snapshot<Value> snapshot;
  std::atomic<bool> stop{false};
  std::thread writer([&] {
    Value value;
    for (std::uint64_t i = 1; !stop.load(); ++i) {
      value.words.fill(i);
      snapshot.write(value);
    }
  });
  std::uint64_t last = 0;
  for (int i = 0; i < 100'000; ++i) {
    const Value value = snapshot.read();
    for (const std::uint64_t word : value.words) ASSERT_EQ(word, value.words[0]);
    ASSERT_GE(value.words[0], last);
    last = value.words[0];
  }
  stop = true;
  writer.join();
}

}  // namespace
}  // namespace eampc::realtime
