// Counts durations in µs into fixed bins: 1 µs wide up to 64 µs, then 32 per octave (3 %
// resolution) up to 16 s. One thread adds, any thread reads. Cost of add(): one increment.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstdint>

namespace eampc::realtime {

class LatencyHistogram {
 public:
  void add(double duration_us) noexcept {
    // Not a number and negative durations (a stepped clock) count as zero.
    const auto whole_us = static_cast<std::uint32_t>(
        duration_us > 0.0 ? std::min(duration_us, static_cast<double>(kMaxUs)) : 0.0);
    bins_[bin_of(whole_us)].fetch_add(1, std::memory_order_relaxed);
    if (duration_us > max_us_.load(std::memory_order_relaxed)) {
      max_us_.store(duration_us, std::memory_order_relaxed);
    }
  }

  // Upper edge of the bin that holds the given share of all durations; 0 before the first.
  double quantile_us(double share) const noexcept {
    std::uint64_t total = 0;
    for (const auto& bin : bins_) total += bin.load(std::memory_order_relaxed);
    if (total == 0) return 0.0;
    const double wanted = share * static_cast<double>(total);
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < bins_.size(); ++i) {
      seen += bins_[i].load(std::memory_order_relaxed);
      if (static_cast<double>(seen) >= wanted) return std::min(upper_edge_us(i), max_us());
    }
    return max_us();
  }
  double max_us() const noexcept { return max_us_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::uint32_t kLinear = 64;
  static constexpr int kLinearBits = 6;
  static constexpr int kMaxBits = 24;  // 2^24 µs = 16.8 s
  static constexpr std::uint32_t kMaxUs = (1u << kMaxBits) - 1;
  static constexpr std::uint32_t kPerOctave = 32;
  static constexpr std::size_t kBins = kLinear + (kMaxBits - kLinearBits) * kPerOctave;

  static std::size_t bin_of(std::uint32_t us) noexcept {
    if (us < kLinear) return us;
    const int octave = static_cast<int>(std::bit_width(us)) - 1 - kLinearBits;  // 0 for 64..127
    return kLinear + static_cast<std::uint32_t>(octave) * kPerOctave +
           ((us >> (octave + 1)) - kPerOctave);
  }
  static double upper_edge_us(std::size_t bin) noexcept {
    if (bin < kLinear) return static_cast<double>(bin + 1);
    const auto above = static_cast<std::uint32_t>(bin) - kLinear;
    const std::uint32_t octave = above / kPerOctave;
    return static_cast<double>((kPerOctave + above % kPerOctave + 1)) *
           static_cast<double>(1u << (octave + 1));
  }

  std::array<std::atomic<std::uint64_t>, kBins> bins_{};
  std::atomic<double> max_us_{0.0};
};

}  // namespace eampc::realtime
