// Missed deadlines within the last safety.deadline_overruns_window_s, in sixteen steps: between
// fifteen and sixteen sixteenths of the window are seen. Cost: at most sixteen steps.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace eampc::control {

class OverrunWindow {
 public:
  explicit OverrunWindow(std::int32_t window_periods) noexcept
      : step_periods_(std::max(1, window_periods / kSteps)) {}

  // The sum over the window, the new ones included.
  std::int64_t add(std::int32_t elapsed_periods, std::int32_t overruns) noexcept {
    periods_in_step_ += elapsed_periods;
    for (int i = 0; i < kSteps && periods_in_step_ >= step_periods_; ++i) {
      periods_in_step_ -= step_periods_;
      newest_ = (newest_ + 1) % kSteps;
      sum_ -= std::exchange(counts_[newest_], 0);
    }
    periods_in_step_ = std::min(periods_in_step_, step_periods_ - 1);
    counts_[newest_] += overruns;
    sum_ += overruns;
    return sum_;
  }

 private:
  static constexpr int kSteps = 16;

  const std::int32_t step_periods_;
  std::int32_t periods_in_step_ = 0;
  std::size_t newest_ = 0;
  std::array<std::int64_t, kSteps> counts_{};
  std::int64_t sum_ = 0;
};

}  // namespace eampc::control
