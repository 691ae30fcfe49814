#include "control/monitor_codec.hpp"

#include "control/frame_codec.hpp"

namespace eampc::control {
namespace {

bool is(const MonitoredLayout& layout, const Frame& frame) noexcept {
  return layout.present && frame.id == layout.id && frame.extended == layout.extended;
}

bool intact(const MonitoredLayout& layout, const Frame& frame) noexcept {
  return !frame.remote && frame.length == layout.length &&
         (!layout.crc.present || frame_crc(frame.data, layout.length, layout.crc) ==
                                     frame.data[static_cast<std::size_t>(layout.crc.byte)]);
}

double value_of(const Frame& frame, const SignalLayout& signal) noexcept {
  return signal.present ? decode_signal(frame.data, signal) : 0.0;
}

}  // namespace

bool MonitorCodec::asks_for_start(const Frame& frame) const noexcept {
  const HeartbeatLayout& layout = config_.heartbeat;
  return config_.node_start.present && layout.state.present && is(layout, frame) &&
         intact(layout, frame) &&
         extract_bits(frame.data, layout.state) != config_.node_start.operational_raw;
}

void MonitorCodec::observe(const Frame& frame) noexcept {
  if (is(config_.valve_feedback, frame)) {
    if (!intact(config_.valve_feedback, frame)) return;
    sample_.feedback_seen = true;
    sample_.pressure1_kPa = value_of(frame, config_.valve_feedback.pressure1);
    sample_.pressure2_kPa = value_of(frame, config_.valve_feedback.pressure2);
    sample_.supply_pressure_kPa = value_of(frame, config_.valve_feedback.supply_pressure);
  } else if (is(config_.heartbeat, frame)) {
    if (!intact(config_.heartbeat, frame)) return;
    sample_.heartbeat_seen = !asks_for_start(frame);
    const SignalLayout& state = config_.heartbeat.state;
    if (state.present && extract_bits(frame.data, state) == 0) sample_.emergency_over = true;
  } else if (is(config_.emergency, frame)) {
    const SignalLayout& code = config_.emergency.error_code;
    const bool over =
        intact(config_.emergency, frame) && code.present && extract_bits(frame.data, code) == 0;
    sample_.emergency |= !over;
    sample_.emergency_over = over;
  } else if (is(config_.e_stop, frame)) {
    const EStopLayout& layout = config_.e_stop;
    const bool released =
        intact(layout, frame) && extract_bits(frame.data, layout.stop) == layout.released_raw;
    sample_.e_stop |= !released;
    sample_.e_stop_released = released;
  } else if (is(config_.identity, frame)) {
    if (!intact(config_.identity, frame)) return;
    const bool agrees =
        extract_bits(frame.data, config_.identity.inputs_crc32) == config_.inputs_crc32;
    sample_.identity_differs |= !agrees;
    sample_.identity_agrees = agrees;
  }
}

MonitorSample MonitorCodec::take() noexcept {
  const MonitorSample taken = sample_;
  sample_ = {};
  sample_.pressure1_kPa = taken.pressure1_kPa;
  sample_.pressure2_kPa = taken.pressure2_kPa;
  sample_.supply_pressure_kPa = taken.supply_pressure_kPa;
  return taken;
}

}  // namespace eampc::control
