// Stage 6. In: both voltages and their windows (V) → out: the valve frame, and the voltages as they
// stand in it. Rounds to the nearest count inside the window, so that rounding breaks neither the
// box nor the slew limit. Cost: the bits of at most four signals and one CRC-8. Absent: any
// decision on what to send.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

struct EncodedCommand {
  Frame frame;
  ValveVoltages sent;  // decoded from the frame's own bits
};

class ValveCodec {
 public:
  explicit ValveCodec(const ValveCommandLayout& layout) noexcept : layout_(layout) {}

  // Each call is one command: the rolling counter moves on.
  EncodedCommand encode(const ValveDemand& demand) noexcept;

 private:
  const ValveCommandLayout& layout_;
  std::uint64_t counter_ = 0;
};

// The valve node's side of the same layout, for the simulated joint and for tests. False: length or
// CRC is wrong.
bool decode_valve_frame(const ValveCommandLayout& layout, const Frame& frame,
                        ValveVoltages& voltages) noexcept;

}  // namespace eampc::control
