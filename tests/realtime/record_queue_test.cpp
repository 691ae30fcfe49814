#include "realtime/record_queue.hpp"

#include <gtest/gtest.h>

#include <thread>

namespace eampc::realtime {
namespace {

struct Item {
  std::uint64_t number = 0;
  std::uint64_t square = 0;
};

TEST(RecordQueue, KeepsOrderAndCountsWhatItRefuses) {
  RecordQueue<Item, 4> queue;
  for (std::uint64_t i = 0; i < 6; ++i) EXPECT_EQ(queue.push({i, i * i}), i < 4);
  EXPECT_EQ(queue.dropped(), 2u);
  EXPECT_FALSE(queue.has_room());
  Item item;
  for (std::uint64_t i = 0; i < 4; ++i) {
    ASSERT_TRUE(queue.pop(item));
    EXPECT_EQ(item.number, i);
  }
  EXPECT_FALSE(queue.pop(item));
  EXPECT_TRUE(queue.has_room());
}

TEST(RecordQueue, CarriesEveryItemWholeBetweenTwoThreads) {
  constexpr std::uint64_t kItems = 300'000;
  RecordQueue<Item, 64> queue;
  std::thread writer([&] {
    for (std::uint64_t i = 0; i < kItems; ++i) {
      while (!queue.push({i, i * i})) std::this_thread::yield();
    }
  });
  Item item;
  for (std::uint64_t expected = 0; expected < kItems; ++expected) {
    while (!queue.pop(item)) std::this_thread::yield();
    ASSERT_EQ(item.number, expected);
    ASSERT_EQ(item.square, expected * expected);
  }
  writer.join();
}

}  // namespace
}  // namespace eampc::realtime
