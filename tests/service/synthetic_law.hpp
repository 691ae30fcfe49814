// A small valid law file, built key by key with msgpack, and ways to damage it: u = −40 e1 − 2 e2 +
// u_ss on the ideal-valve reference joint, its only hyperplane at e1 = 0 with the same piece on
// both sides.
#pragma once

#include <zlib.h>

#include <cstdint>
#include <functional>
#include <map>
#include <msgpack.hpp>
#include <string>
#include <variant>
#include <vector>

#include "control/fault.hpp"

namespace eampc::service {

// A MessagePack value that can be built and changed.
struct Tree {
  using Map = std::map<std::string, Tree>;
  using List = std::vector<Tree>;
  using Bytes = std::vector<char>;
  std::variant<std::nullptr_t, bool, std::int64_t, double, std::string, Bytes, List, Map> value =
      nullptr;

  Tree() = default;
  Tree(bool v) : value(v) {}                      // NOLINT(google-explicit-constructor)
  Tree(int v) : value(std::int64_t{v}) {}         // NOLINT(google-explicit-constructor)
  Tree(std::int64_t v) : value(v) {}              // NOLINT(google-explicit-constructor)
  Tree(double v) : value(v) {}                    // NOLINT(google-explicit-constructor)
  Tree(const char* v) : value(std::string(v)) {}  // NOLINT(google-explicit-constructor)
  Tree(Bytes v) : value(std::move(v)) {}          // NOLINT(google-explicit-constructor)
  Tree(List v) : value(std::move(v)) {}           // NOLINT(google-explicit-constructor)
  Tree(Map v) : value(std::move(v)) {}            // NOLINT(google-explicit-constructor)

  Tree& operator[](const std::string& key) { return std::get<Map>(value)[key]; }
  void erase(const std::string& key) { std::get<Map>(value).erase(key); }

  void pack(msgpack::packer<msgpack::sbuffer>& to) const {
    if (const auto* v = std::get_if<bool>(&value)) {
      to.pack(*v);
    } else if (const auto* whole = std::get_if<std::int64_t>(&value)) {
      to.pack(*whole);
    } else if (const auto* number = std::get_if<double>(&value)) {
      to.pack(*number);
    } else if (const auto* text = std::get_if<std::string>(&value)) {
      to.pack(*text);
    } else if (const auto* bytes = std::get_if<Bytes>(&value)) {
      to.pack_bin(static_cast<std::uint32_t>(bytes->size()));
      to.pack_bin_body(bytes->data(), static_cast<std::uint32_t>(bytes->size()));
    } else if (const auto* list = std::get_if<List>(&value)) {
      to.pack_array(static_cast<std::uint32_t>(list->size()));
      for (const Tree& entry : *list) entry.pack(to);
    } else if (const auto* map = std::get_if<Map>(&value)) {
      to.pack_map(static_cast<std::uint32_t>(map->size()));
      for (const auto& [key, entry] : *map) {
        to.pack(key);
        entry.pack(to);
      }
    } else {
      to.pack_nil();
    }
  }
};

template <typename T>
Tree array(const std::vector<int>& shape, const std::vector<T>& values) {
  Tree::List sizes;
  for (const int size : shape) sizes.emplace_back(size);
  const char* first = reinterpret_cast<const char*>(values.data());
  return Tree::Map{
      {"shape", sizes},
      {sizeof(T) == 8 ? "f64" : "i32", Tree::Bytes(first, first + values.size() * sizeof(T))}};
}

inline Tree matrix(int rows, int columns, const std::vector<double>& values) {
  return array({rows, columns}, values);
}
inline Tree vector(const std::vector<double>& values) {
  return array({static_cast<int>(values.size())}, values);
}

inline Tree signal(int start, int length, bool is_signed, double factor) {
  return Tree::Map{{"start_bit", start},     {"length", length}, {"little_endian", true},
                   {"is_signed", is_signed}, {"factor", factor}, {"offset", 0}};
}

inline Tree integers(const std::vector<std::int32_t>& values) {
  return array({static_cast<int>(values.size())}, values);
}

// One node that compares e1 with 0 and ends in the same leaf everywhere. By hand: 8·2·5 + 1 for the
// node, 8·(2·5 + 1) for the leaf.
inline Tree synthetic_evaluator() {
  return Tree::Map{{"kind", "tree"},
                   {"worst_operations", 81 + 88},
                   {"hyperplanes", matrix(1, 6, {1, 0, 0, 0, 0, 0})},
                   {"root", 0},
                   {"depth", 1},
                   {"node_planes", array<std::int32_t>({1, 7}, {0, -1, -1, -1, -1, -1, -1})},
                   {"node_children", array<std::int32_t>({1, 8}, {-1, -1, -1, -1, -1, -1, -1, -1})},
                   {"leaf_care", array<std::int32_t>({0, 2}, {})},
                   {"leaf_bits", array<std::int32_t>({0, 2}, {})},
                   {"leaf_first", integers({0, 1})},
                   {"term_first", integers({0, 1})},
                   {"term_pieces", integers({0})},
                   {"fold", vector({0, 0, 0, 0, 0})}};
}

// Every cause with the action of its number, modulo four.
inline Tree synthetic_safety() {
  Tree::Map actions;
  for (std::size_t number = 1; number < control::kFaultCount; ++number) {
    actions[control::fault_name(static_cast<control::Fault>(number))] =
        control::action_name(static_cast<control::StopAction>(number % 4));
  }
  return Tree::Map{{"encoder_timeout_s", 0.02},         {"arming_ramp_s", 0.5},
                   {"soft_stop_ramp_s", 0.5},           {"reduced_limits_s", 0.25},
                   {"reduced_control_share", 0.4},      {"reduced_slew_V_per_s", 300.0},
                   {"encoder_invalid_frames", 5},       {"encoder_frozen_s", 0.1},
                   {"encoder_frozen_command_V", 0.6},   {"encoder_jump_velocity_rad_s", 18.0},
                   {"encoder_jump_margin_rad", 0.07},   {"encoder_counter_gap_max", 2},
                   {"encoder_status_mask", 12},         {"error_passive_s", 0.3},
                   {"tx_unconfirmed_periods", 3},       {"send_refused_frames", 4},
                   {"heartbeat_timeout_s", 0.35},       {"e_stop_timeout_s", 0.15},
                   {"supply_pressure_min_kPa", 500.0},  {"supply_pressure_max_kPa", Tree()},
                   {"supply_pressure_s", 0.2},          {"deadline_overruns_max", 7},
                   {"deadline_overruns_window_s", 2.0}, {"actions", actions},
                   {"reference_angle_max_rad", 1.0}};
}

inline Tree synthetic_payload() {
  const Tree crc181 = Tree::Map{{"byte", 7}, {"data_id", 0x181}};
  const Tree crc201 = Tree::Map{{"byte", 7}, {"data_id", 0x201}};
  return Tree::Map{
      {"rig", Tree::Map{{"name", "synthetic"},
                        {"description", "a joint of a test"},
                        {"variant", ""},
                        {"inputs_sha256", "0123456789abcdef"},
                        {"inputs_crc32", std::int64_t{4000000000}},
                        {"eampc_version", "0.1.0"}}},
      {"timing", Tree::Map{{"period_s", 0.005}, {"trigger", "encoder"}}},
      {"model", Tree::Map{{"order", 2},
                          {"A", matrix(2, 2, {0, 1, -300, -10})},
                          {"B", vector({0, 38})},
                          {"A_star", matrix(2, 2, {0.996, 0.0049, -1.46, 0.947})},
                          {"B_star", vector({0.0005, 0.185})},
                          {"D", matrix(2, 2, {0.005, 0.000012, -0.0037, 0.0049})},
                          {"b", 38.0},
                          {"b1", -300.0},
                          {"b2", -10.0},
                          {"valve_time_constant_s", 0.0}}},
      {"estimator", Tree::Map{{"kind", "adaptive"},
                              {"decay", 0.975},
                              {"D_inverse", matrix(2, 2, {200, -0.5, 150, 204})},
                              {"bias_compensation", true},
                              {"low_pass_alpha", 0.22},
                              {"as_printed", false},
                              {"kalman_state_gain", vector({0, 0})},
                              {"kalman_disturbance_gain", 0.0}}},
      {"law", Tree::Map{{"formulation", "tracking"},
                        {"reference_is_parameter", false},
                        {"fixed_reference_rad", 0.0},
                        {"u_min", -10.0},
                        {"u_max", 10.0},
                        {"parameter_names", Tree::List{"e1", "e2", "u_ss", "y_r", "dy_r"}},
                        {"parameter_units", Tree::List{"rad", "rad/s", "", "rad", "rad/s"}},
                        {"lower", vector({-1.5, -10, -22, -1, -6})},
                        {"upper", vector({1.5, 10, 22, 1, 6})},
                        {"piece_gain", matrix(1, 5, {-40, -2, 1, 0, 0})},
                        {"piece_offset", vector({0})},
                        {"evaluator", synthetic_evaluator()},
                        {"active_sets", array<std::int32_t>({1, 1}, {0})},
                        {"statistics", Tree::Map{{"regions", 1},
                                                 {"pieces", 1},
                                                 {"depth", 1},
                                                 {"nodes", 1},
                                                 {"rows_before", 2},
                                                 {"rows_kept", 2},
                                                 {"seconds", 0.1}}}}},
      {"valve", Tree::Map{{"bias_V", 5},
                          {"control_gain_V", 0.45},
                          {"min_V", 0},
                          {"max_V", 10},
                          {"safe_V", 0.0},
                          {"slew_max_V_per_s", 4000.0}}},
      {"safety", synthetic_safety()},
      {"bus",
       Tree::Map{
           {"encoder", Tree::Map{{"id", 0x181},
                                 {"extended", false},
                                 {"length", 8},
                                 {"crc", crc181},
                                 {"signals", Tree::Map{{"angle", signal(0, 24, true, 4.8e-5)},
                                                       {"velocity", signal(24, 16, true, 0.0005)},
                                                       {"counter", signal(40, 4, false, 1)},
                                                       {"status", signal(44, 4, false, 1)}}}}},
           {"valve_command",
            Tree::Map{{"id", 0x201},
                      {"extended", false},
                      {"length", 8},
                      {"crc", crc201},
                      {"signals", Tree::Map{{"u1", signal(0, 16, true, 0.001)},
                                            {"u2", signal(16, 16, true, 0.001)},
                                            {"enable", signal(32, 1, false, 1)},
                                            {"counter", signal(36, 4, false, 1)}}}}},
           {"sync", Tree::Map{{"id", 128},
                              {"extended", false},
                              {"length", 1},
                              {"counter_signal", signal(0, 8, false, 1)}}},
           {"valve_feedback",
            Tree::Map{{"id", 0x182},
                      {"extended", false},
                      {"length", 8},
                      {"signals", Tree::Map{{"supply_pressure", signal(32, 16, false, 0.1)}}}}},
           {"heartbeat", Tree::Map{{"id", 0x701},
                                   {"extended", false},
                                   {"length", 1},
                                   {"signals", Tree::Map{{"state", signal(0, 8, false, 1)}}}}},
           {"emergency", Tree()},
           {"e_stop", Tree::Map{{"id", 0x10},
                                {"extended", false},
                                {"length", 1},
                                {"released_raw", 1},
                                {"signals", Tree::Map{{"stop", signal(0, 1, false, 1)}}}}},
           {"identity", Tree()}}},
      {"telemetry",
       Tree::Map{{"lcm_url", "none"}, {"state_decimation", 1}, {"reference_by_lcm", false}}},
  };
}

inline std::vector<std::uint8_t> bytes_of(const msgpack::sbuffer& buffer) {
  return {reinterpret_cast<const std::uint8_t*>(buffer.data()),
          reinterpret_cast<const std::uint8_t*>(buffer.data()) + buffer.size()};
}

inline std::vector<std::uint8_t> law_bytes(const Tree& payload, std::int64_t version = 3,
                                           const std::string& format = "eampc-law") {
  msgpack::sbuffer inner;
  msgpack::packer<msgpack::sbuffer> inner_packer(inner);
  payload.pack(inner_packer);
  msgpack::sbuffer outer;
  msgpack::packer<msgpack::sbuffer> to(outer);
  to.pack_map(4);
  to.pack(std::string("format"));
  to.pack(format);
  to.pack(std::string("version"));
  to.pack(version);
  to.pack(std::string("crc32"));
  to.pack(static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(inner.data()), inner.size())));
  to.pack(std::string("payload"));
  to.pack_bin(static_cast<std::uint32_t>(inner.size()));
  to.pack_bin_body(inner.data(), static_cast<std::uint32_t>(inner.size()));
  return bytes_of(outer);
}

}  // namespace eampc::service
