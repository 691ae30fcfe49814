// Stage 1. In: the encoder frame of this period, or none → out: angle rad, velocity rad/s, and a
// verdict on both. Order of the checks: length, CRC, counter, range. Cost: the bits of at most four
// signals and one CRC-8. Absent: any opinion on how long a silence may last (safety), any
// difference over arrival times.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

class EncoderCodec {
 public:
  explicit EncoderCodec(const EncoderLayout& layout) noexcept : layout_(layout) {}

  // A frame of another identifier counts as none. Only a valid frame moves the counter on.
  EncoderSample decode(const Frame* frame) noexcept;

 private:
  const EncoderLayout& layout_;
  bool counter_known_ = false;
  std::uint64_t last_counter_ = 0;
};

// The encoder's side of the same layout, for the simulated joint and for tests. `counter` is taken
// modulo the signal's range.
Frame encode_encoder_frame(const EncoderLayout& layout, double angle_rad, double velocity_rad_s,
                           std::uint64_t counter, std::uint64_t status_raw) noexcept;

}  // namespace eampc::control
