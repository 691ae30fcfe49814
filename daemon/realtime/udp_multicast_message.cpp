#include "realtime/udp_multicast_message.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <string_view>

namespace eampc::realtime {
namespace {

// MessagePack type bytes used here: https://github.com/msgpack/msgpack/blob/master/spec.md
constexpr std::uint8_t kNil = 0xc0, kFalse = 0xc2, kTrue = 0xc3, kBin8 = 0xc4, kBin16 = 0xc5,
                       kFloat32 = 0xca, kFloat64 = 0xcb, kUint8 = 0xcc, kUint16 = 0xcd,
                       kUint32 = 0xce, kUint64 = 0xcf, kInt8 = 0xd0, kInt64 = 0xd3, kStr8 = 0xd9,
                       kStr16 = 0xda, kMap16 = 0xde;

class Writer {
 public:
  explicit Writer(UdpMessage& message) noexcept : message_(message) {}

  void byte(std::uint8_t value) noexcept { message_[size_++] = value; }
  void big_endian(std::uint64_t value, int bytes) noexcept {
    for (int i = bytes - 1; i >= 0; --i) byte(static_cast<std::uint8_t>(value >> (8 * i)));
  }
  void key(std::string_view text) noexcept {  // all keys are shorter than 32 characters
    byte(static_cast<std::uint8_t>(0xa0 | text.size()));
    for (const char c : text) byte(static_cast<std::uint8_t>(c));
  }
  void boolean(std::string_view name, bool value) noexcept {
    key(name);
    byte(value ? kTrue : kFalse);
  }
  void unsigned_integer(std::uint32_t value) noexcept {
    if (value < 128) {
      byte(static_cast<std::uint8_t>(value));
    } else if (value <= 0xff) {
      byte(kUint8);
      big_endian(value, 1);
    } else if (value <= 0xffff) {
      byte(kUint16);
      big_endian(value, 2);
    } else {
      byte(kUint32);
      big_endian(value, 4);
    }
  }
  std::size_t size() const noexcept { return size_; }

 private:
  UdpMessage& message_;
  std::size_t size_ = 0;
};

struct Value {
  enum class Kind : std::uint8_t {
    kNothing,
    kBool,
    kInteger,
    kFloat,
    kText,
    kBytes
  } kind = Kind::kNothing;
  bool boolean = false;
  std::uint64_t integer = 0;
  std::span<const std::uint8_t> bytes;
};

class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) noexcept : bytes_(bytes) {}

  bool at_end() const noexcept { return bytes_.empty(); }

  bool map_size(std::size_t& size) noexcept {
    std::uint64_t head = 0;
    if (!big_endian(1, head)) return false;
    if ((head & 0xf0) == 0x80) {
      size = head & 0x0f;
      return true;
    }
    std::uint64_t count = 0;
    if (head != kMap16 || !big_endian(2, count)) return false;
    size = count;
    return true;
  }

  bool value(Value& value) noexcept {
    std::uint64_t head = 0;
    if (!big_endian(1, head)) return false;
    const auto type = static_cast<std::uint8_t>(head);
    std::uint64_t length = 0;
    using Kind = Value::Kind;
    if (type < 0x80) {
      value.kind = Kind::kInteger;
      value.integer = type;
      return true;
    }
    if ((type & 0xe0) == 0xa0) return take(type & 0x1fu, Kind::kText, value);
    switch (type) {
      case kNil:
        value.kind = Kind::kNothing;
        return true;
      case kFalse:
      case kTrue:
        value.kind = Kind::kBool;
        value.boolean = type == kTrue;
        return true;
      case kBin8:
        return big_endian(1, length) && take(length, Kind::kBytes, value);
      case kBin16:
        return big_endian(2, length) && take(length, Kind::kBytes, value);
      case kStr8:
        return big_endian(1, length) && take(length, Kind::kText, value);
      case kStr16:
        return big_endian(2, length) && take(length, Kind::kText, value);
      case kFloat32:
        value.kind = Kind::kFloat;
        return big_endian(4, length);
      case kFloat64:
        value.kind = Kind::kFloat;
        return big_endian(8, length);
      case kUint8:
      case kUint16:
      case kUint32:
      case kUint64:
        value.kind = Kind::kInteger;
        return big_endian(1 << (type - kUint8), value.integer);
      default:
        break;
    }
    // Negative numbers occur only as a timestamp or a channel; their value is not needed.
    value.kind = Kind::kFloat;
    if (type >= 0xe0) return true;
    if (type >= kInt8 && type <= kInt64) return big_endian(1 << (type - kInt8), length);
    return false;  // nothing nested, no extension types
  }

 private:
  bool big_endian(int count, std::uint64_t& value) noexcept {
    if (bytes_.size() < static_cast<std::size_t>(count)) return false;
    value = 0;
    for (int i = 0; i < count; ++i) value = (value << 8) | bytes_[static_cast<std::size_t>(i)];
    bytes_ = bytes_.subspan(static_cast<std::size_t>(count));
    return true;
  }
  bool take(std::uint64_t length, Value::Kind kind, Value& value) noexcept {
    if (bytes_.size() < length) return false;
    value.kind = kind;
    value.bytes = bytes_.first(length);
    bytes_ = bytes_.subspan(length);
    return true;
  }

  std::span<const std::uint8_t> bytes_;
};

std::string_view text_of(const Value& value) noexcept {
  return {reinterpret_cast<const char*>(value.bytes.data()), value.bytes.size()};
}

}  // namespace

std::size_t pack_udp_message(const control::Frame& frame, double timestamp_s,
                             UdpMessage& message) noexcept {
  Writer writer(message);
  const std::size_t length = std::min<std::size_t>(frame.length, frame.data.size());
  writer.byte(0x80 | 11);
  writer.key("timestamp");
  writer.byte(kFloat64);
  writer.big_endian(std::bit_cast<std::uint64_t>(timestamp_s), 8);
  writer.key("arbitration_id");
  writer.unsigned_integer(frame.id);
  writer.boolean("is_extended_id", frame.extended);
  writer.boolean("is_remote_frame", frame.remote);
  writer.boolean("is_error_frame", false);
  writer.key("channel");
  writer.byte(kNil);
  writer.key("dlc");
  writer.unsigned_integer(static_cast<std::uint32_t>(length));
  writer.key("data");
  writer.byte(kBin8);
  const std::size_t data_length = frame.remote ? 0 : length;
  writer.byte(static_cast<std::uint8_t>(data_length));
  for (std::size_t i = 0; i < data_length; ++i) writer.byte(frame.data[i]);
  writer.boolean("is_fd", false);
  writer.boolean("bitrate_switch", false);
  writer.boolean("error_state_indicator", false);
  return writer.size();
}

std::optional<ParsedUdpMessage> parse_udp_message(std::span<const std::uint8_t> bytes) noexcept {
  Reader reader(bytes);
  std::size_t entries = 0;
  // python-can writes eleven; its Message has one more, is_rx.
  if (!reader.map_size(entries) || entries > 16) return std::nullopt;

  ParsedUdpMessage parsed;
  bool has_id = false, has_extended = false, has_data = false, is_fd = false;
  std::uint64_t dlc = 0;
  std::size_t data_length = 0;
  parsed.frame.extended = true;  // python-can's default
  for (std::size_t i = 0; i < entries; ++i) {
    Value key, value;
    if (!reader.value(key) || key.kind != Value::Kind::kText || !reader.value(value)) {
      return std::nullopt;
    }
    const std::string_view name = text_of(key);
    const bool is_bool = value.kind == Value::Kind::kBool;
    if (name == "arbitration_id") {
      if (value.kind != Value::Kind::kInteger || value.integer >= (1u << 29)) return std::nullopt;
      parsed.frame.id = static_cast<std::uint32_t>(value.integer);
      has_id = true;
    } else if (name == "is_extended_id") {
      if (!is_bool) return std::nullopt;
      parsed.frame.extended = value.boolean;
      has_extended = true;
    } else if (name == "is_remote_frame") {
      if (!is_bool) return std::nullopt;
      parsed.frame.remote = value.boolean;
    } else if (name == "is_error_frame") {
      if (!is_bool) return std::nullopt;
      parsed.is_error_frame = value.boolean;
    } else if (name == "is_fd") {
      if (!is_bool) return std::nullopt;
      is_fd = value.boolean;
    } else if (name == "dlc") {
      if (value.kind != Value::Kind::kInteger) return std::nullopt;
      dlc = value.integer;
    } else if (name == "data") {
      if (value.kind != Value::Kind::kBytes || value.bytes.size() > parsed.frame.data.size()) {
        return std::nullopt;
      }
      std::copy(value.bytes.begin(), value.bytes.end(), parsed.frame.data.begin());
      data_length = value.bytes.size();
      has_data = true;
    } else if (name != "timestamp" && name != "channel" && name != "bitrate_switch" &&
               name != "error_state_indicator" && name != "is_rx") {
      return std::nullopt;
    }
  }
  if (!reader.at_end() || !has_id || !has_extended || is_fd || dlc > parsed.frame.data.size()) {
    return std::nullopt;
  }
  if (!parsed.frame.extended && parsed.frame.id >= (1u << 11)) return std::nullopt;
  if (!parsed.frame.remote && !parsed.is_error_frame && (!has_data || data_length != dlc)) {
    return std::nullopt;
  }
  parsed.frame.length = static_cast<std::uint8_t>(dlc);
  return parsed;
}

}  // namespace eampc::realtime
