// One value of a law file's payload with the way to it, so that every error names its key.
// In: MessagePack objects of the whole file. Out: checked numbers, texts and arrays, or
// LawFileError.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <msgpack.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "service/law_file.hpp"

namespace eampc::service {

inline constexpr const char* kLawFileRemedy = "; design it again with eampc design";
// Sizes beyond these are damage, not laws: the largest reference-like law has some thousand pieces.
inline constexpr std::int64_t kMaxEntries = 4'000'000;

static_assert(std::endian::native == std::endian::little, "array blobs are little-endian");

class LawValue {
 public:
  LawValue(const msgpack::object& object, std::string path, const std::string& file)
      : object_(&object), path_(std::move(path)), file_(&file) {}

  [[noreturn]] void fail(const std::string& what) const {
    std::string said = (path_.empty() ? "" : path_ + " ") + what;
    // Keys and texts come from the file: a control character would end or break the sentence.
    for (char& c : said) {
      if (static_cast<unsigned char>(c) < ' ') c = '?';
    }
    throw LawFileError(*file_ + ": " + said + kLawFileRemedy);
  }

  std::optional<LawValue> find(const std::string& key) const {
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
        return LawValue(map.ptr[i].val, path_.empty() ? key : path_ + "." + key, *file_);
      }
    }
    return std::nullopt;
  }

  LawValue at(const std::string& key) const {
    std::optional<LawValue> value = find(key);
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
      values.push_back(LawValue(object_->via.array.ptr[i], path_, *file_).text());
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
      const std::string key = LawValue(entry.key, path_, *file_).text();
      values[key] = LawValue(entry.val, path_ + "." + key, *file_).number();
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
    const LawValue shape = at("shape");
    if (shape.object_->type != msgpack::type::ARRAY) {
      shape.fail("is not a list");
    }
    std::string found;
    std::int64_t entries = 1;
    bool as_expected = shape.object_->via.array.size == expected.size();
    for (std::uint32_t i = 0; i < shape.object_->via.array.size; ++i) {
      const std::int64_t size = LawValue(shape.object_->via.array.ptr[i], path_ + ".shape", *file_)
                                    .integer(0, kMaxEntries);
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
    const LawValue bytes = at(type);
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

}  // namespace eampc::service
