#include "control/valve_codec.hpp"

#include <cmath>

#include "control/frame_codec.hpp"

namespace eampc::control {
namespace {

// Bounds come from sums of doubles; this much past them is rounding, not motion.
constexpr double kBoundTolerance_V = 1e-9;

bool inside(const VoltageWindow& window, double voltage_V) noexcept {
  return voltage_V >= window.lower_V - kBoundTolerance_V &&
         voltage_V <= window.upper_V + kBoundTolerance_V;
}

double encode_voltage(FrameData& data, const SignalLayout& layout, double voltage_V,
                      const VoltageWindow& window) noexcept {
  std::uint64_t raw = nearest_raw(layout, voltage_V);
  if (!inside(window, physical_of_raw(layout, raw))) {
    // One count towards the middle of the window. It lies inside: the loader refuses a slew limit
    // below one count per period, so the window is at least one count wide.
    const double middle_V = 0.5 * (window.lower_V + window.upper_V);
    const double rounded_V = physical_of_raw(layout, raw);
    raw = nearest_raw(layout,
                      rounded_V + std::copysign(std::abs(layout.factor), middle_V - rounded_V));
  }
  insert_bits(data, layout, raw);
  return physical_of_raw(layout, raw);
}

}  // namespace

EncodedCommand ValveCodec::encode(const ValveDemand& demand) noexcept {
  EncodedCommand command;
  Frame& frame = command.frame;
  frame.id = layout_.id;
  frame.extended = layout_.extended;
  frame.length = static_cast<std::uint8_t>(layout_.length);
  command.sent.enable = demand.voltages.enable;
  command.sent.u1_V = encode_voltage(frame.data, layout_.u1, demand.voltages.u1_V, demand.u1);
  command.sent.u2_V = encode_voltage(frame.data, layout_.u2, demand.voltages.u2_V, demand.u2);
  if (layout_.enable.present) {
    insert_bits(frame.data, layout_.enable, demand.voltages.enable ? 1 : 0);
  }
  if (layout_.counter.present) {
    insert_bits(frame.data, layout_.counter, counter_);
    ++counter_;
  }
  if (layout_.crc.present) {
    frame.data[static_cast<std::size_t>(layout_.crc.byte)] =
        frame_crc(frame.data, layout_.length, layout_.crc);
  }
  return command;
}

bool decode_valve_frame(const ValveCommandLayout& layout, const Frame& frame,
                        ValveVoltages& voltages) noexcept {
  if (frame.length != layout.length ||
      (layout.crc.present && frame_crc(frame.data, layout.length, layout.crc) !=
                                 frame.data[static_cast<std::size_t>(layout.crc.byte)])) {
    return false;
  }
  voltages.u1_V = decode_signal(frame.data, layout.u1);
  voltages.u2_V = decode_signal(frame.data, layout.u2);
  voltages.enable = !layout.enable.present || extract_bits(frame.data, layout.enable) != 0;
  return true;
}

}  // namespace eampc::control
