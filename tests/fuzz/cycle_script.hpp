// Bytes → a story of cycles: frames good and bad, silences, operator edges, references, bus
// reports. One opcode byte per cycle and its operands behind it, so that a fuzzer reaches ACTIVE by
// a few bytes and can still damage every bit of a frame.
#pragma once

#include <array>
#include <cmath>

#include "control/encoder_codec.hpp"
#include "control/frame_codec.hpp"
#include "fuzz/checked_cycle.hpp"

namespace eampc::fuzz {

class CycleScript {
 public:
  // Beyond any ramp of fuzz_configurations.hpp, and a few thousand cases per second.
  static constexpr int kMostCycles = 1024;
  static constexpr int kLongestRun = 64;

  CycleScript(const control::ControllerConfig& config, ByteReader bytes) noexcept
      : config_(config), bytes_(bytes), cycle_(config) {}

  void run() noexcept {
    while (!bytes_.at_end() && cycles_ < kMostCycles) play(bytes_.take<std::uint8_t>());
  }

 private:
  enum Opcode : std::uint8_t {
    kSilence,
    kGoodFrame,
    kGoodFrames,
    kAnyValues,
    kAnyBytes,
    kRepeatedFrame,
    kAct,
    kReferenceOfNumbers,
    kReferenceOfTable,
    kBusReport,
    kSilences,
    kDamagedFrame,
    kMonitoredMessage,
    kOpcodes
  };

  void play(std::uint8_t code) noexcept {
    switch (static_cast<Opcode>(code % kOpcodes)) {
      case kSilence:
        return step(nullptr);
      case kSilences:
        for (int i = run_length(); i > 0; --i) step(nullptr);
        return;
      case kGoodFrame:
        return good_frame(bytes_.take<std::int8_t>());
      case kGoodFrames: {
        const int count = run_length();
        const auto step_raw = bytes_.take<std::int8_t>();
        for (int i = 0; i < count; ++i) good_frame(step_raw);
        return;
      }
      case kAnyValues: {
        angle_rad_ = 1e-3 * bytes_.take<std::int16_t>();
        const double velocity_rad_s = 1e-2 * bytes_.take<std::int16_t>();
        counter_ += bytes_.take<std::uint8_t>();
        return send(velocity_rad_s, bytes_.take<std::uint8_t>());
      }
      case kAnyBytes: {
        const auto kind = bytes_.take<std::uint8_t>();
        frame_.id = (kind & 1) != 0 ? bytes_.take<std::uint32_t>() : config_.encoder.id;
        frame_.extended = ((kind & 2) != 0) != config_.encoder.extended;
        frame_.remote = (kind & 4) != 0;
        frame_.length = std::min<std::uint8_t>((kind >> 4) & 15, 8);
        for (std::uint8_t& byte : frame_.data) byte = bytes_.take<std::uint8_t>();
        return step(&frame_);
      }
      case kRepeatedFrame:
        return step(&frame_);
      case kDamagedFrame:
        good_frame_bytes(0.0, 0);
        frame_.data[bytes_.take<std::uint8_t>() % 8] ^= bytes_.take<std::uint8_t>();
        return step(&frame_);
      case kAct:
        input_.action = static_cast<control::OperatorAction>(bytes_.take<std::uint8_t>() % 4);
        return good_frame(0);
      case kReferenceOfNumbers:
        return reference_of_numbers();
      case kReferenceOfTable:
        return reference_of_table();
      case kBusReport:
        report_bus(bytes_.take<std::uint8_t>());
        return good_frame(0);
      case kMonitoredMessage:
        return monitored_message(bytes_.take<std::uint8_t>());
      case kOpcodes:
        return;
    }
  }

  int run_length() noexcept { return 1 + bytes_.take<std::uint8_t>() % kLongestRun; }

  static control::CycleInput on_a_healthy_bus() noexcept {
    control::CycleInput input;
    input.bus.queue_proved_empty = true;
    return input;
  }
  // Whatever the loop may report.
  void report_bus(std::uint8_t bits) noexcept {
    control::BusHealth& bus = input_.bus;
    bus.link_down = (bits & 1) != 0;
    bus.bus_off = (bits & 2) != 0;
    bus.error_passive = (bits & 4) != 0;
    bus.not_acknowledged = (bits & 8) != 0;
    bus.send_refused = (bits & 16) != 0;
    bus.queue_proved_empty = (bits & 32) == 0;
    bus.unconfirmed_periods = bits >> 6;
    bus.deadline_overruns = bits == 0xff ? 1000 : 0;
  }

  // Any bytes in any of the messages that the rig monitors, before the next cycle.
  void monitored_message(std::uint8_t choice) noexcept {
    const std::array<const control::MonitoredLayout*, 5> layouts{
        &config_.valve_feedback, &config_.heartbeat, &config_.emergency, &config_.e_stop,
        &config_.identity};
    const control::MonitoredLayout& layout = *layouts[choice % layouts.size()];
    control::Frame frame;
    frame.id = layout.id;
    frame.extended = layout.extended;
    frame.length = std::min<std::uint8_t>(choice >> 4, 8);
    for (std::uint8_t& byte : frame.data) byte = bytes_.take<std::uint8_t>();
    cycle_.observe(frame);
    e_stop_pressed_ |=
        layout.present && &layout == &config_.e_stop &&
        (frame.length != layout.length ||
         control::extract_bits(frame.data, config_.e_stop.stop) != config_.e_stop.released_raw);
  }
  // What healthy nodes send beside the encoder.
  void observe_healthy_nodes() noexcept {
    if (!config_.heartbeat.present) return;
    control::Frame frame;
    frame.id = config_.heartbeat.id;
    frame.length = static_cast<std::uint8_t>(config_.heartbeat.length);
    control::insert_bits(frame.data, config_.heartbeat.state, 5);
    cycle_.observe(frame);
    frame = {};
    frame.id = config_.valve_feedback.id;
    frame.length = static_cast<std::uint8_t>(config_.valve_feedback.length);
    control::encode_signal(frame.data, config_.valve_feedback.supply_pressure, 600.0);
    cycle_.observe(frame);
  }

  void good_frame(std::int8_t step_raw) noexcept {
    observe_healthy_nodes();
    const double velocity_rad_s = 0.02 * step_raw;
    angle_rad_ += config_.model.period_s * velocity_rad_s;
    ++counter_;
    send(velocity_rad_s, 0);
  }
  void good_frame_bytes(double velocity_rad_s, std::uint64_t status_raw) noexcept {
    frame_ = control::encode_encoder_frame(config_.encoder, angle_rad_, velocity_rad_s, counter_,
                                           status_raw);
  }
  void send(double velocity_rad_s, std::uint64_t status_raw) noexcept {
    good_frame_bytes(velocity_rad_s, status_raw);
    step(&frame_);
  }

  void reference_of_numbers() noexcept {
    reference_ = {};
    reference_.kind = static_cast<control::ReferenceKind>(bytes_.take<std::uint8_t>() % 5);
    reference_.amplitude_rad = number();
    reference_.offset_rad = number();
    reference_.start_s = number();
    reference_.frequency_hz = std::abs(number());
    reference_.external = {reference_.amplitude_rad, reference_.offset_rad, reference_.start_s};
    input_.new_reference = &reference_;
    good_frame(0);
  }
  void reference_of_table() noexcept {
    reference_ = {};
    reference_.kind = control::ReferenceKind::kTable;
    for (control::Reference& row : table_) row = {number(), number(), number()};
    reference_.table = table_.data();
    reference_.samples = 1 + bytes_.take<std::uint8_t>() % static_cast<int>(table_.size());
    reference_.sample_period_s = std::abs(number());
    input_.new_reference = &reference_;
    good_frame(0);
  }
  // As operator_request.cpp lets them through: finite, at most 1e6 in size.
  double number() noexcept {
    const auto raw = bytes_.take<std::int16_t>();
    if (raw == INT16_MAX) return 1e6;
    return 1e-3 * raw;
  }

  void step(const control::Frame* frame) noexcept {
    input_.encoder_frame = frame;
    const control::Mode mode = cycle_.step(input_).record.mode;
    require(!e_stop_pressed_ || (mode != control::Mode::kArming && mode != control::Mode::kActive),
            "nothing moves up in the cycle that sees the stop button");
    e_stop_pressed_ = false;
    input_ = on_a_healthy_bus();
    ++cycles_;
  }

  const control::ControllerConfig& config_;
  ByteReader bytes_;
  CheckedCycle cycle_;
  control::CycleInput input_ = on_a_healthy_bus();
  bool e_stop_pressed_ = false;
  control::Frame frame_;
  control::ReferenceTrajectory reference_;
  std::array<control::Reference, 3> table_{};
  double angle_rad_ = 0.0;
  std::uint64_t counter_ = 0;
  int cycles_ = 0;
};

}  // namespace eampc::fuzz
