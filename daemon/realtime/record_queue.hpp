// Bounded queue from exactly one thread to exactly one other. push() and pop() never wait: a full
// queue refuses, and the refusals are counted. Cost: one copy and two atomic operations; a push is
// about 0.1 µs.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace eampc::realtime {

template <typename Item, std::size_t kCapacity>
class RecordQueue {
  static_assert((kCapacity & (kCapacity - 1)) == 0, "the index wraps by a mask");
  static_assert(std::is_trivially_copyable_v<Item>, "an item must cross without a heap");

 public:
  bool push(const Item& item) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) == kCapacity) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    items_[tail & (kCapacity - 1)] = item;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  bool pop(Item& item) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return false;
    item = items_[head & (kCapacity - 1)];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  // For the pushing thread: whether push() would succeed now.
  bool has_room() const noexcept {
    return tail_.load(std::memory_order_relaxed) - head_.load(std::memory_order_acquire) <
           kCapacity;
  }

  std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t kCacheLineBytes =
      64;  // x86-64 and Cortex-A; keeps the two ends apart

  alignas(kCacheLineBytes) std::atomic<std::size_t> head_{0};
  alignas(kCacheLineBytes) std::atomic<std::size_t> tail_{0};
  std::atomic<std::uint64_t> dropped_{0};
  alignas(kCacheLineBytes) std::array<Item, kCapacity> items_{};
};

}  // namespace eampc::realtime
