// What every fuzz target shares: libFuzzer's entry, numbers read from its bytes, and the check that
// ends the process. Without clang the same targets are linked to replay_main.cpp.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <span>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace eampc::fuzz {

// An invariant is not an assert: it holds in every build, and a fuzzer sees the abort.
inline void require(bool holds, const char* invariant) noexcept {
  if (holds) return;
  std::fprintf(stderr, "invariant broken: %s\n", invariant);
  std::abort();
}

// Any bytes are a valid sequence of numbers: past the end everything is zero.
class ByteReader {
 public:
  ByteReader(const std::uint8_t* data, std::size_t size) : bytes_(data, size) {}

  bool at_end() const noexcept { return bytes_.empty(); }
  template <typename T>
  T take() noexcept {
    T value{};
    const std::size_t size = std::min(sizeof value, bytes_.size());
    if (size > 0) std::memcpy(&value, bytes_.data(), size);
    bytes_ = bytes_.subspan(size);
    return value;
  }
  std::span<const std::uint8_t> take_bytes(std::size_t count) noexcept {
    const auto taken = bytes_.first(std::min(count, bytes_.size()));
    bytes_ = bytes_.subspan(taken.size());
    return taken;
  }
  std::span<const std::uint8_t> rest() noexcept { return take_bytes(bytes_.size()); }

 private:
  std::span<const std::uint8_t> bytes_;
};

}  // namespace eampc::fuzz
