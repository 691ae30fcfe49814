#include "service/law_file.hpp"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <limits>
#include <msgpack.hpp>
#include <optional>

#include "control/frame_codec.hpp"

namespace eampc::service {
namespace {

using control::ControllerConfig;
using control::SignalLayout;

constexpr std::int64_t kVersion = 1;
constexpr const char* kRemedy = "; design it again with eampc design";
// Sizes beyond these are damage, not laws: the largest reference-like law has some thousand pieces.
constexpr std::int64_t kMaxEntries = 4'000'000;
// A hundred times the reference law's 2 MB.
constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{200} << 20;
// The bounds of control.period_s in rig.toml; shorter ones would round to 0 ns, or ramps overflow.
constexpr double kShortestPeriod_s = 1e-4;
constexpr double kLongestPeriod_s = 1.0;
constexpr double kVoltageTolerance_V = 1e-6;  // the file's numbers come from a sum and a division

static_assert(std::endian::native == std::endian::little, "array blobs are little-endian");

// One value of the payload with the way to it, so that every error names its key.
class Value {
 public:
  Value(const msgpack::object& object, std::string path, const std::string& file)
      : object_(&object), path_(std::move(path)), file_(&file) {}

  [[noreturn]] void fail(const std::string& what) const {
    throw LawFileError(*file_ + ": " + (path_.empty() ? "" : path_ + " ") + what + kRemedy);
  }

  std::optional<Value> find(const std::string& key) const {
    if (object_->type != msgpack::type::MAP) {
      fail("is not a table");
    }
    const auto& map = object_->via.map;
    for (std::uint32_t i = 0; i < map.size; ++i) {
      const msgpack::object& name = map.ptr[i].key;
      if (name.type == msgpack::type::STR &&
          key == std::string_view(name.via.str.ptr, name.via.str.size)) {
        if (map.ptr[i].val.type == msgpack::type::NIL) {
          return std::nullopt;
        }
        return Value(map.ptr[i].val, path_.empty() ? key : path_ + "." + key, *file_);
      }
    }
    return std::nullopt;
  }

  Value at(const std::string& key) const {
    std::optional<Value> value = find(key);
    if (!value) {
      fail(path_.empty() ? "the section " + key + " is missing" : "lacks the key " + key);
    }
    return *value;
  }

  double number() const {
    double value = 0.0;
    switch (object_->type) {
      case msgpack::type::FLOAT64:
      case msgpack::type::FLOAT32:
        value = object_->via.f64;
        break;
      case msgpack::type::POSITIVE_INTEGER:
        value = static_cast<double>(object_->via.u64);
        break;
      case msgpack::type::NEGATIVE_INTEGER:
        value = static_cast<double>(object_->via.i64);
        break;
      default:
        fail("is not a number");
    }
    if (!std::isfinite(value)) {
      fail("is not a finite number");
    }
    return value;
  }

  double number_in(double lower, double upper) const {
    const double value = number();
    if (value < lower || value > upper) {
      fail("is " + text_of(value) + ", outside " + text_of(lower) + " to " + text_of(upper));
    }
    return value;
  }

  double positive() const {
    const double value = number();
    if (!(value > 0.0)) {
      fail("is " + text_of(value) + " and must be positive");
    }
    return value;
  }

  double not_negative() const {
    const double value = number();
    if (value < 0.0) {
      fail("is " + text_of(value) + " and must not be negative");
    }
    return value;
  }

  std::int64_t integer(std::int64_t lower, std::int64_t upper) const {
    std::int64_t value = 0;
    if (object_->type == msgpack::type::POSITIVE_INTEGER &&
        object_->via.u64 <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())) {
      value = static_cast<std::int64_t>(object_->via.u64);
    } else if (object_->type == msgpack::type::NEGATIVE_INTEGER) {
      value = object_->via.i64;
    } else {
      fail("is not a whole number");
    }
    if (value < lower || value > upper) {
      fail("is " + std::to_string(value) + ", outside " + std::to_string(lower) + " to " +
           std::to_string(upper));
    }
    return value;
  }

  int small_integer(int lower, int upper) const { return static_cast<int>(integer(lower, upper)); }

  bool boolean() const {
    if (object_->type != msgpack::type::BOOLEAN) {
      fail("is not true or false");
    }
    return object_->via.boolean;
  }

  std::string text() const {
    if (object_->type != msgpack::type::STR) {
      fail("is not a text");
    }
    return std::string(object_->via.str.ptr, object_->via.str.size);
  }

  // The position of the text among `choices`.
  std::size_t choice(std::initializer_list<const char*> choices) const {
    const std::string value = text();
    std::string listed;
    std::size_t i = 0;
    for (const char* choice : choices) {
      if (value == choice) {
        return i;
      }
      listed.append(i++ == 0 ? "" : ", ").append(choice);
    }
    fail("is \"" + value + "\", not one of " + listed);
  }

  std::vector<std::string> texts() const {
    if (object_->type != msgpack::type::ARRAY) {
      fail("is not a list");
    }
    std::vector<std::string> values;
    for (std::uint32_t i = 0; i < object_->via.array.size; ++i) {
      values.push_back(Value(object_->via.array.ptr[i], path_, *file_).text());
    }
    return values;
  }

  std::map<std::string, double> numbers() const {
    if (object_->type != msgpack::type::MAP) {
      fail("is not a table");
    }
    std::map<std::string, double> values;
    for (std::uint32_t i = 0; i < object_->via.map.size; ++i) {
      const auto& entry = object_->via.map.ptr[i];
      const std::string key = Value(entry.key, path_, *file_).text();
      values[key] = Value(entry.val, path_ + "." + key, *file_).number();
    }
    return values;
  }

  // An array blob of exactly this shape; −1 stands for any number of rows.
  std::vector<double> doubles(const std::vector<std::int64_t>& shape) const {
    std::vector<double> values = blob<double>("f64", shape);
    for (const double value : values) {
      if (!std::isfinite(value)) {
        fail("holds a number that is not finite");
      }
    }
    return values;
  }

  std::vector<std::int32_t> integers(const std::vector<std::int64_t>& shape) const {
    return blob<std::int32_t>("i32", shape);
  }

 private:
  static std::string text_of(double value) {
    std::string text(32, '\0');
    text.resize(static_cast<std::size_t>(std::snprintf(text.data(), text.size(), "%.9g", value)));
    return text;
  }

  template <typename T>
  std::vector<T> blob(const char* type, const std::vector<std::int64_t>& expected) const {
    const Value shape = at("shape");
    if (shape.object_->type != msgpack::type::ARRAY) {
      shape.fail("is not a list");
    }
    std::string found;
    std::int64_t entries = 1;
    bool as_expected = shape.object_->via.array.size == expected.size();
    for (std::uint32_t i = 0; i < shape.object_->via.array.size; ++i) {
      const std::int64_t size =
          Value(shape.object_->via.array.ptr[i], path_ + ".shape", *file_).integer(0, kMaxEntries);
      found.append(i == 0 ? "" : "x").append(std::to_string(size));
      as_expected = as_expected && (expected[i] < 0 || expected[i] == size);
      entries = std::min(entries * size, kMaxEntries + 1);
    }
    if (!as_expected || entries > kMaxEntries) {
      std::string wanted;
      for (std::size_t i = 0; i < expected.size(); ++i) {
        wanted.append(i == 0 ? "" : "x")
            .append(expected[i] < 0 ? "n" : std::to_string(expected[i]));
      }
      fail("has the shape " + found + ", expected " + wanted);
    }
    const Value bytes = at(type);
    const std::size_t size = static_cast<std::size_t>(entries) * sizeof(T);
    if (bytes.object_->type != msgpack::type::BIN || bytes.object_->via.bin.size != size) {
      bytes.fail("does not hold the " + std::to_string(size) + " bytes of its shape");
    }
    std::vector<T> values(static_cast<std::size_t>(entries));
    if (size > 0) {
      std::memcpy(values.data(), bytes.object_->via.bin.ptr, size);
    }
    return values;
  }

  const msgpack::object* object_;
  std::string path_;
  const std::string* file_;
};

// --- outer container
// ---------------------------------------------------------------------------------------------------

// Total size that the header of the payload promises, or 0 if no header is in sight.
std::size_t promised_size(std::span<const std::uint8_t> bytes) {
  const std::string key = "\xa7payload";
  const auto end =
      bytes.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(bytes.size(), 256));
  const auto found =
      std::search(bytes.begin(), end, key.begin(), key.end(),
                  [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); });
  if (found == end) {
    return 0;
  }
  std::size_t position = static_cast<std::size_t>(found - bytes.begin()) + key.size();
  if (position >= bytes.size()) {
    return 0;
  }
  const std::uint8_t type = bytes[position++];
  const std::size_t length_bytes = type == 0xc4 ? 1 : type == 0xc5 ? 2 : type == 0xc6 ? 4 : 0;
  if (length_bytes == 0 || position + length_bytes > bytes.size()) {
    return 0;
  }
  std::size_t length = 0;
  for (std::size_t i = 0; i < length_bytes; ++i) {
    length = length << 8 | bytes[position++];
  }
  return position + length;
}

msgpack::object_handle unpacked(const char* data, std::size_t size, const std::string& file,
                                const char* what) {
  // Headers that promise millions of entries are damage; without a limit they would be allocated
  // first.
  constexpr std::size_t kEntries = 10'000;
  constexpr std::size_t kBytes = 0xFFFFFFFF;
  constexpr std::size_t kDepth = 32;
  try {
    return msgpack::unpack(data, size, nullptr, nullptr,
                           msgpack::unpack_limit(kEntries, kEntries, kBytes, kBytes, 0, kDepth));
  } catch (const msgpack::unpack_error&) {
    throw LawFileError(file + ": " + what + " is not whole MessagePack" + kRemedy);
  }
}

// --- sections
// ------------------------------------------------------------------------------------------------------------

void read_model(const Value& model, double period_s, control::DiscreteModel& out) {
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

void read_estimator(const Value& estimator, double period_s, control::EstimatorConfig& out) {
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

// Longest path from `root` in splits. Children may be shared, a circle is refused.
int checked_height(const Value& tree, const std::vector<control::SplitNode>& nodes,
                   std::int32_t root) {
  if (root < 0) {
    return 0;
  }
  constexpr int kUnseen = -1;
  constexpr int kOpen = -2;
  std::vector<int> height(nodes.size(), kUnseen);
  std::vector<std::int32_t> path{root};
  while (!path.empty()) {
    const auto node = static_cast<std::size_t>(path.back());
    height[node] = kOpen;
    int longest = 0;
    bool complete = true;
    for (const std::int32_t child : {nodes[node].below, nodes[node].above}) {
      if (child < 0) {
        continue;
      }
      const int known = height[static_cast<std::size_t>(child)];
      if (known == kOpen) {
        tree.fail("runs in a circle at node " + std::to_string(child));
      }
      if (known == kUnseen) {
        path.push_back(child);
        complete = false;
        break;
      }
      longest = std::max(longest, known);
    }
    if (complete) {
      height[node] = longest + 1;
      path.pop_back();
    }
  }
  return height[static_cast<std::size_t>(root)];
}

void read_tree(const Value& tree, int np, control::SearchTree& out,
               std::vector<control::SplitNode>& nodes, std::vector<control::AffinePiece>& pieces) {
  const std::vector<double> hyperplanes = tree.at("hyperplanes").doubles({-1, np + 1});
  const std::size_t row = static_cast<std::size_t>(np) + 1;
  const std::size_t planes = hyperplanes.size() / row;
  const std::vector<std::int32_t> split = tree.at("split").integers({-1});
  nodes.resize(split.size());
  const std::vector<std::int32_t> children =
      tree.at("children").integers({static_cast<std::int64_t>(nodes.size()), 2});
  const std::vector<double> gains = tree.at("piece_gain").doubles({-1, np});
  pieces.resize(gains.size() / static_cast<std::size_t>(np));
  const std::vector<double> offsets =
      tree.at("piece_offset").doubles({static_cast<std::int64_t>(pieces.size())});
  if (pieces.empty()) {
    tree.at("piece_gain").fail("holds no piece");
  }
  const auto in_range = [&](std::int32_t child) {
    return child >= 0 ? static_cast<std::size_t>(child) < nodes.size()
                      : static_cast<std::size_t>(~child) < pieces.size();
  };
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    nodes[i] = {};
    if (split[i] < 0 || static_cast<std::size_t>(split[i]) >= planes) {
      tree.at("split").fail("names a hyperplane that does not exist, at node " + std::to_string(i));
    }
    const double* plane = &hyperplanes[static_cast<std::size_t>(split[i]) * row];
    std::copy_n(plane, np, nodes[i].normal);
    nodes[i].offset = plane[np];
    nodes[i].below = children[2 * i];
    nodes[i].above = children[2 * i + 1];
    if (!in_range(nodes[i].below) || !in_range(nodes[i].above)) {
      tree.at("children")
          .fail("names a node or piece that does not exist, at node " + std::to_string(i));
    }
  }
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    pieces[i] = {};
    std::copy_n(&gains[i * static_cast<std::size_t>(np)], np, pieces[i].gain);
    pieces[i].offset = offsets[i];
  }
  constexpr std::int64_t kLast = std::numeric_limits<std::int32_t>::max();
  const auto root = static_cast<std::int32_t>(tree.at("root").integer(-kLast, kLast));
  if (!in_range(root)) {
    tree.at("root").fail("names a node or piece that does not exist");
  }
  const int depth = static_cast<int>(tree.at("depth").integer(0, kLast));
  const int height = checked_height(tree, nodes, root);
  if (height > depth) {
    tree.at("depth").fail("is " + std::to_string(depth) + ", but a path of the tree has " +
                          std::to_string(height) + " splits");
  }
  out.n_parameters = np;
  out.depth = depth;
  out.root = root;
  out.nodes = nodes;
  out.pieces = pieces;
}

void read_law(const Value& law, const ControllerConfig& config, control::LawConfig& out) {
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

void read_valve(const Value& valve, const Value& law, const ControllerConfig& config,
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

void read_safety(const Value& safety, double period_s, control::SafetyConfig& out) {
  constexpr double kLongest_s =
      3600.0;  // 3.6e7 of the shortest periods: several such ramps still count in 32 bits
  out.encoder_timeout_s = safety.at("encoder_timeout_s").number_in(period_s, kLongest_s);
  out.arming_ramp_s = safety.at("arming_ramp_s").number_in(0.0, kLongest_s);
  out.soft_stop_ramp_s = safety.at("soft_stop_ramp_s").number_in(0.0, kLongest_s);
  const auto action = [&](const char* key) {
    return static_cast<control::StopAction>(
        safety.at(key).choice({"saturate", "soft_stop", "vent_ramp", "immediate"}));
  };
  out.encoder_timeout_action = action("encoder_timeout_action");
  out.encoder_invalid_action = action("encoder_invalid_action");
  out.reference_angle_max_rad = safety.at("reference_angle_max_rad").positive();
}

// Reads the signals of one frame and keeps the bits that are taken.
class FrameReader {
 public:
  FrameReader(const Value& message, std::uint32_t& id, bool& extended, int& length)
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
    const std::optional<Value> signal = message_.at("signals").find(name);
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

  SignalLayout read(const Value& signal) {
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
  void take(const Value& signal, std::uint64_t bits) {
    if ((taken_ & bits) != 0) {
      signal.fail("overlaps another signal of its frame");
    }
    taken_ |= bits;
  }

  const Value& message_;
  int length_ = 0;
  std::uint64_t taken_ = 0;
};

void check_covers(const Value& message, const char* name, const SignalLayout& layout,
                  const ControllerConfig& config) {
  const Value signal = message.at("signals").at(name);
  const double first_V = control::raw_minimum(layout) * layout.factor + layout.offset;
  const double last_V = control::raw_maximum(layout) * layout.factor + layout.offset;
  const double count_V = std::abs(layout.factor);
  if (std::min(first_V, last_V) > config.valve.min_V + 0.5 * count_V ||
      std::max(first_V, last_V) < config.valve.max_V - 0.5 * count_V) {
    signal.fail("cannot carry every voltage from valve.min_V to valve.max_V");
  }
  if (config.valve.slew_max_V_per_s * config.model.period_s < count_V) {
    signal.fail("has counts larger than valve.slew_max_V_per_s allows in one period");
  }
  if (config.valve.max_V - config.valve.min_V < count_V) {
    signal.fail("has counts larger than the range of the valve");
  }
}

void read_bus(const Value& bus, ControllerConfig& config) {
  constexpr int kCounterBits = 32;  // gaps are counted in 32 bits; a DBC's counters have 4 or 8
  {
    const Value message = bus.at("encoder");
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
    const Value message = bus.at("valve_command");
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
  if (config.trigger_on_sync && !config.sync.present) {
    bus.fail("has no sync message, but timing.trigger is \"sync\"");
  }
}

void read_meta(const Value& payload, LawMeta& meta) {
  const Value rig = payload.at("rig");
  meta.rig_name = rig.at("name").text();
  meta.description = rig.at("description").text();
  meta.variant = rig.at("variant").text();
  meta.inputs_sha256 = rig.at("inputs_sha256").text();
  meta.inputs_crc32 = static_cast<std::uint32_t>(rig.at("inputs_crc32").integer(0, 0xFFFFFFFF));
  meta.eampc_version = rig.at("eampc_version").text();
  const Value law = payload.at("law");
  meta.formulation = law.at("formulation").text();
  meta.trigger = payload.at("timing").at("trigger").text();
  meta.parameter_names = law.at("parameter_names").texts();
  meta.parameter_units = law.at("parameter_units").texts();
  meta.statistics = law.at("statistics").numbers();
  const Value telemetry = payload.at("telemetry");
  meta.lcm_url = telemetry.at("lcm_url").text();
  meta.state_decimation = telemetry.at("state_decimation").small_integer(1, 1'000'000);
  meta.reference_by_lcm = telemetry.at("reference_by_lcm").boolean();
}

}  // namespace

LawFile LawFile::load(const std::string& path) {
  // A pipe would be waited for, a device read for ever.
  std::error_code unreadable;
  const auto status = std::filesystem::status(path, unreadable);
  if (std::filesystem::exists(status)) {
    if (!std::filesystem::is_regular_file(status)) {
      throw LawFileError(path + ": is not a regular file; make it with eampc design");
    }
    if (std::filesystem::file_size(path, unreadable) > kMaxFileBytes) {
      throw LawFileError(path + ": is larger than " + std::to_string(kMaxFileBytes >> 20) +
                         " MiB, which no law is; make it with eampc design");
    }
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    throw LawFileError(path + ": cannot be opened (" + std::strerror(errno) +
                       "); make it with eampc design");
  }
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file),
                                std::istreambuf_iterator<char>()};
  if (file.bad() || bytes.empty()) {
    throw LawFileError(path + ": is empty or cannot be read; make it with eampc design");
  }
  return from_bytes({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, path);
}

LawFile LawFile::from_bytes(std::span<const std::uint8_t> bytes, const std::string& name) {
  const std::size_t promised = promised_size(bytes);
  if (bytes.size() < promised) {
    throw LawFileError(name + ": truncated (got " + std::to_string(bytes.size()) + " of " +
                       std::to_string(promised) + " bytes)" + kRemedy);
  }
  const msgpack::object_handle outer =
      unpacked(reinterpret_cast<const char*>(bytes.data()), bytes.size(), name, "the file");
  if (outer.get().type != msgpack::type::MAP) {
    throw LawFileError(name + ": is not a law file" + kRemedy);
  }
  const Value container(outer.get(), "", name);
  const std::optional<Value> format = container.find("format");
  if (!format || format->text() != "eampc-law") {
    throw LawFileError(name + ": is not a law file" + kRemedy);
  }
  const std::int64_t version =
      container.at("version").integer(0, std::numeric_limits<std::int32_t>::max());
  if (version != kVersion) {
    container.fail("has version " + std::to_string(version) + ", this eampcd reads version " +
                   std::to_string(kVersion));
  }
  const auto checksum = static_cast<std::uint32_t>(container.at("crc32").integer(0, 0xFFFFFFFF));
  const auto& payload_object = [&]() -> const msgpack::object& {
    const auto& map = outer.get().via.map;
    for (std::uint32_t i = 0; i < map.size; ++i) {
      if (map.ptr[i].key.type == msgpack::type::STR &&
          std::string_view(map.ptr[i].key.via.str.ptr, map.ptr[i].key.via.str.size) == "payload" &&
          map.ptr[i].val.type == msgpack::type::BIN) {
        return map.ptr[i].val;
      }
    }
    container.fail("holds no payload");
  }();
  const char* payload_bytes = payload_object.via.bin.ptr;
  const std::size_t payload_size = payload_object.via.bin.size;
  if (crc32_z(0, reinterpret_cast<const Bytef*>(payload_bytes), payload_size) != checksum) {
    throw LawFileError(name + ": damaged (the checksum does not match)" + kRemedy);
  }
  const msgpack::object_handle inner = unpacked(payload_bytes, payload_size, name, "the payload");
  const Value payload(inner.get(), "", name);

  LawFile law;
  ControllerConfig& config = law.config_;
  const Value timing = payload.at("timing");
  const double period_s = timing.at("period_s").number_in(kShortestPeriod_s, kLongestPeriod_s);
  config.trigger_on_sync = timing.at("trigger").choice({"encoder", "sync"}) == 1;
  read_model(payload.at("model"), period_s, config.model);
  read_estimator(payload.at("estimator"), period_s, config.estimator);
  const Value law_section = payload.at("law");
  read_law(law_section, config, config.law);
  const int np = static_cast<int>(law_section.at("parameter_names").texts().size());
  read_tree(law_section.at("tree"), np, config.law.tree, law.nodes_, law.pieces_);
  read_valve(payload.at("valve"), law_section, config, config.valve);
  read_safety(payload.at("safety"), period_s, config.safety);
  read_bus(payload.at("bus"), config);
  read_meta(payload, law.meta_);
  return law;
}

}  // namespace eampc::service
