#include "service/operator_request.hpp"

#include <bit>
#include <cmath>
#include <cstring>
#include <msgpack.hpp>
#include <string_view>

#include "service/options.hpp"
#include "service/record_texts.hpp"

namespace eampc::service {
namespace {

static_assert(std::endian::native == std::endian::little,
              "tables and lengths are read as they lie in memory");

// 2^53: beyond it a Python float that was meant as a cycle is no longer exact.
constexpr std::int64_t kMaxCycle = std::int64_t{1} << 53;
// Nothing mechanical is faster, later or larger; the point is that sums and products stay finite.
constexpr double kMaxMagnitude = 1e6;

// A key comes from anybody: what is not printable would end the sentence or upset its reader.
std::string quoted(std::string_view key) {
  constexpr std::size_t kLongest = 40;
  std::string text = "\"";
  for (const char c : key.substr(0, kLongest)) text += c >= ' ' && c <= '~' ? c : '?';
  return text + "\"";
}

double number_of(const msgpack::object& value, std::string_view key) {
  double number = NAN;
  switch (value.type) {
    case msgpack::type::FLOAT32:
    case msgpack::type::FLOAT64:
      number = value.via.f64;
      break;
    case msgpack::type::POSITIVE_INTEGER:
      number = static_cast<double>(value.via.u64);
      break;
    case msgpack::type::NEGATIVE_INTEGER:
      number = static_cast<double>(value.via.i64);
      break;
    default:
      break;
  }
  if (!std::isfinite(number) || std::fabs(number) > kMaxMagnitude) {
    throw BadInput(quoted(key) + " must be a finite number of at most 1e6 in size");
  }
  return number;
}

std::string_view text_of(const msgpack::object& value, std::string_view key) {
  if (value.type != msgpack::type::STR) throw BadInput(quoted(key) + " must be a text");
  return {value.via.str.ptr, value.via.str.size};
}

std::int64_t cycle_of(const msgpack::object& value) {
  if (value.type == msgpack::type::NIL) return -1;
  if (value.type == msgpack::type::NEGATIVE_INTEGER && value.via.i64 == -1) return -1;
  if (value.type != msgpack::type::POSITIVE_INTEGER ||
      value.via.u64 > static_cast<std::uint64_t>(kMaxCycle)) {
    throw BadInput("\"at_cycle\" must be a whole number, -1 for now");
  }
  return static_cast<std::int64_t>(value.via.u64);
}

Command command_of(std::string_view name) {
  if (name == "arm") return Command::kArm;
  if (name == "disarm") return Command::kDisarm;
  if (name == "reset") return Command::kReset;
  if (name == "status") return Command::kStatus;
  if (name == "reference") return Command::kReference;
  if (name == "flight") return Command::kFlight;
  throw BadInput("the command must be arm, disarm, reset, status, reference or flight");
}

control::ReferenceKind kind_of(std::string_view name) {
  if (name == "constant") return control::ReferenceKind::kConstant;
  if (name == "step") return control::ReferenceKind::kStep;
  if (name == "sine") return control::ReferenceKind::kSine;
  if (name == "table") return control::ReferenceKind::kTable;
  throw BadInput("the reference's kind must be constant, step, sine or table");
}

std::vector<control::Reference> table_of(const msgpack::object& value) {
  constexpr std::size_t kRowBytes = 3 * sizeof(double);
  if (value.type != msgpack::type::BIN || value.via.bin.size == 0 ||
      value.via.bin.size % kRowBytes != 0 || value.via.bin.size / kRowBytes > kMaxTableRows) {
    throw BadInput("\"table\" must be binary, 1 to " + std::to_string(kMaxTableRows) +
                   " rows of three float64 (rad, rad/s, rad/s^2)");
  }
  std::vector<control::Reference> table(value.via.bin.size / kRowBytes);
  for (std::size_t row = 0; row < table.size(); ++row) {
    double numbers[3];
    std::memcpy(numbers, value.via.bin.ptr + row * kRowBytes, kRowBytes);
    for (const double number : numbers) {
      if (!std::isfinite(number) || std::fabs(number) > kMaxMagnitude) {
        throw BadInput("row " + std::to_string(row) +
                       " of \"table\" is not finite or larger than 1e6");
      }
    }
    table[row] = {numbers[0], numbers[1], numbers[2]};
  }
  return table;
}

}  // namespace

OperatorRequest parse_request(std::span<const std::uint8_t> message) {
  // No nesting, no extension types, a dozen keys; the table is the only large thing.
  const msgpack::unpack_limit limit(0, 16, 64, kMaxTableRows * 24, 0, 2);
  msgpack::object_handle handle;
  try {
    std::size_t used = 0;
    handle = msgpack::unpack(reinterpret_cast<const char*>(message.data()), message.size(), used,
                             nullptr, nullptr, limit);
    if (used != message.size()) throw BadInput("bytes are left over after the request's map");
  } catch (const msgpack::unpack_error&) {
    throw BadInput("the request is not a MessagePack map of the operator protocol");
  }
  const msgpack::object& map = handle.get();
  if (map.type != msgpack::type::MAP) throw BadInput("the request must be a MessagePack map");

  OperatorRequest request;
  bool has_command = false, has_kind = false;
  for (std::uint32_t i = 0; i < map.via.map.size; ++i) {
    const std::string_view key = text_of(map.via.map.ptr[i].key, "key");
    const msgpack::object& value = map.via.map.ptr[i].val;
    if (key == "command") {
      request.command = command_of(text_of(value, key));
      has_command = true;
    } else if (key == "at_cycle") {
      request.at_cycle = cycle_of(value);
    } else if (key == "kind") {
      request.reference.kind = kind_of(text_of(value, key));
      has_kind = true;
    } else if (key == "amplitude_rad") {
      request.reference.amplitude_rad = number_of(value, key);
    } else if (key == "offset_rad") {
      request.reference.offset_rad = number_of(value, key);
    } else if (key == "start_s") {
      request.reference.start_s = number_of(value, key);
    } else if (key == "frequency_hz") {
      request.reference.frequency_hz = number_of(value, key);
    } else if (key == "sample_period_s") {
      request.reference.sample_period_s = number_of(value, key);
    } else if (key == "table") {
      if (value.type != msgpack::type::NIL) request.table = table_of(value);
    } else {
      throw BadInput(quoted(key) + " is not a key of the operator protocol");
    }
  }
  if (!has_command) throw BadInput("the request has no \"command\"");
  if (request.command != Command::kReference) return request;

  if (!has_kind) throw BadInput("a reference needs its \"kind\": constant, step, sine or table");
  if (request.reference.kind == control::ReferenceKind::kTable) {
    if (request.table.empty()) throw BadInput("a reference of kind table needs \"table\"");
    if (!(request.reference.sample_period_s > 0.0)) {
      throw BadInput("a reference of kind table needs \"sample_period_s\" above 0");
    }
  } else if (!request.table.empty()) {
    throw BadInput("only a reference of kind table has a \"table\"");
  }
  if (request.reference.kind == control::ReferenceKind::kSine &&
      !(request.reference.frequency_hz >= 0.0)) {
    throw BadInput("\"frequency_hz\" must not be negative");
  }
  return request;
}

std::vector<std::uint8_t> pack_reply(const OperatorReply& reply) {
  msgpack::sbuffer buffer;
  msgpack::packer<msgpack::sbuffer> packer(buffer);
  const control::CycleRecord& cycle = reply.newest.cycle;
  const auto entry = [&](const char* key, const auto& value) {
    packer.pack(key);
    packer.pack(value);
  };
  packer.pack_map(31);
  entry("ok", reply.ok);
  entry("message", reply.message);
  entry("mode", control::mode_text(cycle.mode));
  entry("fault", control::fault_text(cycle.fault));
  entry("fault_number", static_cast<int>(cycle.fault));
  entry("fault_name", control::fault_name(cycle.fault));
  entry("present_faults", cycle.present_faults.bits());
  entry("present_faults_text", causes_text(cycle.present_faults));
  entry("refusal", refusal_sentence(reply.refusal, reply.refusal_cause));
  entry("refusal_number", static_cast<int>(reply.refusal));
  entry("refusal_cause_number", static_cast<int>(reply.refusal_cause));
  entry("limits", cycle.limits);
  entry("limits_text", limits_text(cycle.limits));
  entry("cycle", cycle.cycle);
  entry("scenario_time_s", cycle.scenario_time_s);
  entry("angle_rad", cycle.state.x[0]);
  entry("velocity_rad_s", cycle.state.x[1]);
  entry("disturbance_rad_s2", cycle.disturbance.for_law[1]);
  entry("reference_angle_rad", cycle.reference.angle_rad);
  entry("control", cycle.law.u);
  entry("region", cycle.law.region);
  entry("u1_V", cycle.valves.u1_V);
  entry("u2_V", cycle.valves.u2_V);
  entry("at_rest", reply.newest.at_rest);
  entry("arrival_to_sent_p50_us", reply.arrival_to_sent_p50_us);
  entry("arrival_to_sent_p99_us", reply.arrival_to_sent_p99_us);
  entry("arrival_to_sent_max_us", reply.arrival_to_sent_max_us);
  entry("law_sha256", reply.law_sha256);
  entry("rig_name", reply.rig_name);
  entry("realtime_text", reply.realtime_text);
  packer.pack("counters");
  const realtime::LoopCounters& counters = reply.counters;
  packer.pack_map(17);
  entry("cycles", counters.cycles);
  entry("encoder_frames", counters.encoder_frames);
  entry("valid_frames", counters.valid_frames);
  entry("missed_cycles", counters.missed_cycles());
  entry("encoder_timeouts", counters.encoder_timeouts);
  entry("superseded_frames", counters.superseded_frames);
  entry("late_frames", counters.late_frames);
  entry("duplicate_frames", counters.duplicate_frames);
  entry("invalid_frames", counters.invalid_frames);
  entry("deadline_overruns", counters.deadline_overruns);
  entry("send_errors", counters.send_errors);
  entry("confirmed_frames", counters.confirmed_frames);
  entry("ignored_frames", counters.ignored_frames);
  entry("error_frames", counters.error_frames);
  entry("link_downs", counters.link_downs);
  entry("receive_overflows", counters.receive_overflows);
  entry("telemetry_dropped", counters.telemetry_dropped);

  const auto size = static_cast<std::uint32_t>(buffer.size());
  std::vector<std::uint8_t> message(sizeof size + buffer.size());
  std::memcpy(message.data(), &size, sizeof size);
  std::memcpy(message.data() + sizeof size, buffer.data(), buffer.size());
  return message;
}

}  // namespace eampc::service
