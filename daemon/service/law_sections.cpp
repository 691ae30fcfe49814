#include "service/law_sections.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string>

#include "control/frame_codec.hpp"

namespace eampc::service {
namespace {

using control::ControllerConfig;
using control::SignalLayout;

constexpr double kVoltageTolerance_V = 1e-6;  // the file's numbers come from a sum and a division

}  // namespace

void read_model(const LawValue& model, double period_s, control::DiscreteModel& out) {
  const int n = model.at("order").small_integer(2, control::kMaxStates);
  out.order = n;
  out.period_s = period_s;
  const auto square = [&](const char* key, control::StateMatrix& matrix) {
    const std::vector<double> values = model.at(key).doubles({n, n});
    for (int row = 0; row < n; ++row) {
      for (int column = 0; column < n; ++column) {
        matrix(row, column) = values[static_cast<std::size_t>(row * n + column)];
      }
    }
  };
  const auto column = [&](const char* key, control::StateVector& vector) {
    const std::vector<double> values = model.at(key).doubles({n});
    for (int row = 0; row < n; ++row) {
      vector(row) = values[static_cast<std::size_t>(row)];
    }
  };
  square("A", out.A);
  square("A_star", out.A_star);
  column("B", out.B);
  column("B_star", out.B_star);
  const std::vector<double> D = model.at("D").doubles({n, control::kMaxMeasured});
  for (int row = 0; row < n; ++row) {
    for (int j = 0; j < control::kMaxMeasured; ++j) {
      out.D(row, j) = D[static_cast<std::size_t>(row * control::kMaxMeasured + j)];
    }
  }
  out.b = model.at("b").number();
  out.b1 = model.at("b1").number();
  out.b2 = model.at("b2").number();
  if (out.b == 0.0) {
    model.at("b").fail("is 0: the valves would not move the joint");
  }
  out.valve_time_constant_s = model.at("valve_time_constant_s").not_negative();
  if ((out.valve_time_constant_s > 0.0) != (n == 3)) {
    model.at("order").fail("must be 3 with a valve time constant and 2 without");
  }
}

void read_estimator(const LawValue& estimator, double period_s, control::EstimatorConfig& out) {
  out.kind = estimator.at("kind").choice({"adaptive", "kalman"}) == 0
                 ? control::EstimatorKind::kAdaptive
                 : control::EstimatorKind::kKalman;
  const bool adaptive = out.kind == control::EstimatorKind::kAdaptive;
  out.low_pass_alpha = estimator.at("low_pass_alpha").number_in(1e-9, 1.0);
  out.as_printed = adaptive && estimator.at("as_printed").boolean();
  if (adaptive) {
    out.decay = estimator.at("decay").number_in(1e-9, 1.0);
    out.bias_compensation = estimator.at("bias_compensation").boolean();
    const std::vector<double> inverse =
        estimator.at("D_inverse").doubles({control::kMaxMeasured, control::kMaxMeasured});
    out.D_inverse << inverse[0], inverse[1], inverse[2], inverse[3];
    const double rate_per_s = -std::log(out.decay) / period_s;
    out.held_integral_s = rate_per_s > 0.0 ? (1.0 - out.decay) / rate_per_s : period_s;
  } else {
    const std::vector<double> gain = estimator.at("kalman_state_gain").doubles({2});
    out.kalman_state_gain = {gain[0], gain[1]};
    out.kalman_disturbance_gain = estimator.at("kalman_disturbance_gain").number();
  }
}

void read_law(const LawValue& law, const ControllerConfig& config, control::LawConfig& out) {
  out.formulation = law.at("formulation").choice({"paper", "tracking"}) == 0
                        ? control::Formulation::kPaper
                        : control::Formulation::kTracking;
  int np = 0;
  if (out.formulation == control::Formulation::kPaper) {
    out.reference_is_parameter = law.at("reference_is_parameter").boolean();
    if (!out.reference_is_parameter) {
      out.fixed_reference_rad = law.at("fixed_reference_rad").number();
    }
    np = out.reference_is_parameter ? 5 : 4;
    if (config.model.order != 2) {
      law.at("formulation").fail("is \"paper\", which has no valve state");
    }
  } else {
    np = config.model.order == 3 ? 6 : 5;
  }
  out.u_min = law.at("u_min").number();
  out.u_max = law.at("u_max").number();
  if (!(out.u_min < out.u_max)) {
    law.at("u_max").fail("must be above u_min");
  }
  const std::vector<double> lower = law.at("lower").doubles({np});
  const std::vector<double> upper = law.at("upper").doubles({np});
  for (std::size_t i = 0; i < lower.size(); ++i) {
    if (!(lower[i] <= upper[i])) {
      law.at("upper").fail("is below lower at parameter " + std::to_string(i));
    }
    out.lower[i] = lower[i];
    out.upper[i] = upper[i];
  }
  if (law.at("parameter_names").texts().size() != lower.size()) {
    law.at("parameter_names").fail("does not name every parameter");
  }
}

void read_valve(const LawValue& valve, const LawValue& law, const ControllerConfig& config,
                control::ValveConfig& out) {
  out.min_V = valve.at("min_V").number();
  out.max_V = valve.at("max_V").number();
  if (!(out.min_V < out.max_V)) {
    valve.at("max_V").fail("must be above min_V");
  }
  out.bias_V = valve.at("bias_V").number_in(out.min_V, out.max_V);
  out.safe_V = valve.at("safe_V").number_in(out.min_V, out.max_V);
  out.control_gain_V = valve.at("control_gain_V").positive();
  out.slew_max_V_per_s = valve.at("slew_max_V_per_s").positive();
  const double swing_V =
      out.control_gain_V * std::max(std::abs(config.law.u_min), std::abs(config.law.u_max));
  if (out.bias_V + swing_V > out.max_V + kVoltageTolerance_V ||
      out.bias_V - swing_V < out.min_V - kVoltageTolerance_V) {
    law.at("u_max").fail("lets a valve leave valve.min_V..valve.max_V");
  }
}

namespace {

// Reads the signals of one frame and keeps the bits that are taken.
class FrameReader {
 public:
  FrameReader(const LawValue& message, std::uint32_t& id, bool& extended, int& length)
      : message_(message) {
    extended = message.at("extended").boolean();
    id = static_cast<std::uint32_t>(message.at("id").integer(0, extended ? 0x1FFFFFFF : 0x7FF));
    length = message.at("length").small_integer(0, 8);
    length_ = length;
  }

  SignalLayout required(const char* name) {
    SignalLayout layout = optional(name);
    if (!layout.present) {
      message_.at("signals").fail(std::string("lacks the signal ") + name);
    }
    return layout;
  }

  SignalLayout optional(const char* name) {
    const std::optional<LawValue> signal = message_.at("signals").find(name);
    return signal ? read(*signal) : SignalLayout{};
  }

  // Counter, status and enable are read and written as bits.
  SignalLayout optional_bits(const char* name, int length_max) {
    const SignalLayout layout = optional(name);
    if (layout.present && layout.length > length_max) {
      message_.at("signals").at(name).at("length").fail("is above " + std::to_string(length_max));
    }
    return layout;
  }

  SignalLayout read(const LawValue& signal) {
    SignalLayout layout;
    layout.present = true;
    layout.start_bit = signal.at("start_bit").small_integer(0, 63);
    layout.length = signal.at("length").small_integer(1, 64);
    layout.little_endian = signal.at("little_endian").boolean();
    layout.is_signed = signal.at("is_signed").boolean();
    layout.factor = signal.at("factor").number();
    layout.offset = signal.at("offset").number();
    if (const auto minimum = signal.find("minimum")) layout.minimum = minimum->number();
    if (const auto maximum = signal.find("maximum")) layout.maximum = maximum->number();
    if (layout.factor == 0.0) {
      signal.at("factor").fail("is 0");
    }
    if (!control::fits(layout, length_)) {
      signal.fail("does not fit into its frame of " + std::to_string(length_) + " bytes");
    }
    take(signal, control::occupied_bits(layout));
    return layout;
  }

  control::CrcLayout crc() {
    control::CrcLayout layout;
    if (const auto crc = message_.find("crc")) {
      layout.present = true;
      layout.byte = crc->at("byte").small_integer(0, 7);
      layout.data_id = static_cast<std::uint16_t>(crc->at("data_id").integer(0, 0xFFFF));
      if (layout.byte >= length_) {
        crc->fail("does not fit into its frame of " + std::to_string(length_) + " bytes");
      }
      take(*crc, std::uint64_t{0xFF} << (8 * layout.byte));
    }
    return layout;
  }

 private:
  void take(const LawValue& signal, std::uint64_t bits) {
    if ((taken_ & bits) != 0) {
      signal.fail("overlaps another signal of its frame");
    }
    taken_ |= bits;
  }

  const LawValue& message_;
  int length_ = 0;
  std::uint64_t taken_ = 0;
};

// A message that the rig does not monitor is nil.
std::optional<LawValue> monitored(const LawValue& bus, const char* name,
                                  control::MonitoredLayout& layout,
                                  const ControllerConfig& config) {
  std::optional<LawValue> message = bus.find(name);
  layout.present = message.has_value();
  if (message) {
    const bool extended = message->at("extended").boolean();
    const std::int64_t id = message->at("id").integer(0, extended ? 0x1FFFFFFF : 0x7FF);
    const auto is = [&](const auto& other) { return other.id == id && other.extended == extended; };
    if (is(config.encoder) || is(config.valve_command) ||
        (config.sync.present && is(config.sync))) {
      message->at("id").fail("is that of another message");
    }
  }
  return message;
}

void read_monitored(const LawValue& bus, ControllerConfig& config) {
  if (const auto message = monitored(bus, "valve_feedback", config.valve_feedback, config)) {
    control::ValveFeedbackLayout& layout = config.valve_feedback;
    FrameReader reader(*message, layout.id, layout.extended, layout.length);
    layout.pressure1 = reader.optional("pressure1");
    layout.pressure2 = reader.optional("pressure2");
    layout.supply_pressure = reader.optional("supply_pressure");
    layout.crc = reader.crc();
  }
  if (const auto message = monitored(bus, "heartbeat", config.heartbeat, config)) {
    control::HeartbeatLayout& layout = config.heartbeat;
    FrameReader reader(*message, layout.id, layout.extended, layout.length);
    layout.state = reader.optional("state");
    layout.crc = reader.crc();
  }
  if (const auto message = monitored(bus, "emergency", config.emergency, config)) {
    control::EmergencyLayout& layout = config.emergency;
    FrameReader reader(*message, layout.id, layout.extended, layout.length);
    layout.error_code = reader.optional("error_code");
    layout.crc = reader.crc();
  }
  if (const auto message = monitored(bus, "e_stop", config.e_stop, config)) {
    control::EStopLayout& layout = config.e_stop;
    FrameReader reader(*message, layout.id, layout.extended, layout.length);
    layout.stop = reader.required("stop");
    layout.crc = reader.crc();
    layout.released_raw = static_cast<std::uint64_t>(
        message->at("released_raw").integer(0, std::numeric_limits<std::int64_t>::max()));
  }
  if (const auto message = monitored(bus, "identity", config.identity, config)) {
    control::IdentityLayout& layout = config.identity;
    FrameReader reader(*message, layout.id, layout.extended, layout.length);
    layout.inputs_crc32 = reader.required("inputs_crc32");
    layout.crc = reader.crc();
  }
}

void read_node_start(const LawValue& bus, control::NodeStart& out) {
  const std::optional<LawValue> message = bus.find("nmt_start");
  out.present = message.has_value();
  if (!message) return;
  out.frame.extended = message->at("extended").boolean();
  out.frame.id = static_cast<std::uint32_t>(
      message->at("id").integer(0, out.frame.extended ? 0x1FFFFFFF : 0x7FF));
  out.frame.length = static_cast<std::uint8_t>(message->at("length").small_integer(0, 8));
  const std::int64_t raw =
      message->at("data_raw").integer(0, std::numeric_limits<std::int64_t>::max());
  for (std::size_t i = 0; i < out.frame.length; ++i) {
    out.frame.data[i] = static_cast<std::uint8_t>(raw >> (8 * i));
  }
  out.operational_raw = static_cast<std::uint64_t>(message->at("operational_raw").integer(0, 255));
}

void check_covers(const LawValue& message, const char* name, const SignalLayout& layout,
                  const ControllerConfig& config) {
  const LawValue signal = message.at("signals").at(name);
  const double first_V = control::raw_minimum(layout) * layout.factor + layout.offset;
  const double last_V = control::raw_maximum(layout) * layout.factor + layout.offset;
  const double count_V = std::abs(layout.factor);
  if (std::min(first_V, last_V) > config.valve.min_V + 0.5 * count_V ||
      std::max(first_V, last_V) < config.valve.max_V - 0.5 * count_V) {
    signal.fail("cannot carry every voltage from valve.min_V to valve.max_V");
  }
  if (config.valve.slew_max_V_per_s * config.model.period_s < count_V ||
      config.safety.reduced_slew_V_per_s * config.model.period_s < count_V) {
    signal.fail(
        "has counts larger than valve.slew_max_V_per_s or safety.reduced_slew_V_per_s allows in "
        "one period");
  }
  if (config.valve.max_V - config.valve.min_V < count_V) {
    signal.fail("has counts larger than the range of the valve");
  }
}

}  // namespace

void read_bus(const LawValue& bus, ControllerConfig& config) {
  constexpr int kCounterBits = 32;  // gaps are counted in 32 bits; a DBC's counters have 4 or 8
  {
    const LawValue message = bus.at("encoder");
    control::EncoderLayout& encoder = config.encoder;
    FrameReader reader(message, encoder.id, encoder.extended, encoder.length);
    encoder.angle = reader.required("angle");
    encoder.velocity = reader.optional("velocity");
    encoder.counter = reader.optional_bits("counter", kCounterBits);
    encoder.status = reader.optional_bits("status", 32);
    encoder.crc = reader.crc();
    if (config.estimator.kind == control::EstimatorKind::kAdaptive && !encoder.velocity.present) {
      message.at("signals").fail("lacks the velocity that the adaptive estimator needs");
    }
  }
  {
    const LawValue message = bus.at("valve_command");
    control::ValveCommandLayout& command = config.valve_command;
    FrameReader reader(message, command.id, command.extended, command.length);
    command.u1 = reader.required("u1");
    command.u2 = reader.required("u2");
    command.enable = reader.optional_bits("enable", 8);
    command.counter = reader.optional_bits("counter", kCounterBits);
    command.crc = reader.crc();
    check_covers(message, "u1", command.u1, config);
    check_covers(message, "u2", command.u2, config);
    if (command.id == config.encoder.id && command.extended == config.encoder.extended) {
      message.at("id").fail("is the encoder's own");
    }
  }
  if (const auto message = bus.find("sync")) {
    control::SyncLayout& sync = config.sync;
    FrameReader reader(*message, sync.id, sync.extended, sync.length);
    sync.present = true;
    if (const auto counter = message->find("counter_signal")) {
      sync.counter = reader.read(*counter);
    }
    const auto is_sync = [&](const auto& layout) {
      return layout.id == sync.id && layout.extended == sync.extended;
    };
    if (is_sync(config.encoder) || is_sync(config.valve_command)) {
      message->at("id").fail("is that of another message");  // a Sync would be read as voltages
    }
  }
  read_monitored(bus, config);
  read_node_start(bus, config.node_start);
  if (config.trigger_on_sync && !config.sync.present) {
    bus.fail("has no sync message, but timing.trigger is \"sync\"");
  }
}

void read_meta(const LawValue& payload, LawMeta& meta) {
  const LawValue rig = payload.at("rig");
  meta.rig_name = rig.at("name").text();
  meta.description = rig.at("description").text();
  meta.variant = rig.at("variant").text();
  meta.inputs_sha256 = rig.at("inputs_sha256").text();
  meta.inputs_crc32 = static_cast<std::uint32_t>(rig.at("inputs_crc32").integer(0, 0xFFFFFFFF));
  meta.eampc_version = rig.at("eampc_version").text();
  const LawValue law = payload.at("law");
  meta.formulation = law.at("formulation").text();
  meta.trigger = payload.at("timing").at("trigger").text();
  meta.parameter_names = law.at("parameter_names").texts();
  meta.parameter_units = law.at("parameter_units").texts();
  meta.statistics = law.at("statistics").numbers();
  const LawValue telemetry = payload.at("telemetry");
  meta.lcm_url = telemetry.at("lcm_url").text();
  meta.state_decimation = telemetry.at("state_decimation").small_integer(1, 1'000'000);
  meta.reference_by_lcm = telemetry.at("reference_by_lcm").boolean();
}

}  // namespace eampc::service
