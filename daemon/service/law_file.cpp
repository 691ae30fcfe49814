#include "service/law_file.hpp"

#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <msgpack.hpp>
#include <optional>

#include "service/law_sections.hpp"
#include "service/law_value.hpp"

namespace eampc::service {
namespace {

using control::ControllerConfig;

constexpr std::int64_t kVersion = 3;
// A hundred times the reference law's 2 MB.
constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{200} << 20;
// The bounds of control.period_s in rig.toml; shorter ones would round to 0 ns, or ramps overflow.
constexpr double kShortestPeriod_s = 1e-4;
constexpr double kLongestPeriod_s = 1.0;

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
    throw LawFileError(file + ": " + what + " is not whole MessagePack" + kLawFileRemedy);
  }
}

}  // namespace

LawFile LawFile::load(const std::string& path, control::EvaluationPath evaluation) {
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
  return from_bytes({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, path,
                    evaluation);
}

LawFile LawFile::from_bytes(std::span<const std::uint8_t> bytes, const std::string& name,
                            control::EvaluationPath evaluation) {
  const std::size_t promised = promised_size(bytes);
  if (bytes.size() < promised) {
    throw LawFileError(name + ": truncated (got " + std::to_string(bytes.size()) + " of " +
                       std::to_string(promised) + " bytes)" + kLawFileRemedy);
  }
  const msgpack::object_handle outer =
      unpacked(reinterpret_cast<const char*>(bytes.data()), bytes.size(), name, "the file");
  if (outer.get().type != msgpack::type::MAP) {
    throw LawFileError(name + ": is not a law file" + kLawFileRemedy);
  }
  const LawValue container(outer.get(), "", name);
  const std::optional<LawValue> format = container.find("format");
  if (!format || format->text() != "eampc-law") {
    throw LawFileError(name + ": is not a law file" + kLawFileRemedy);
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
    throw LawFileError(name + ": damaged (the checksum does not match)" + kLawFileRemedy);
  }
  const msgpack::object_handle inner = unpacked(payload_bytes, payload_size, name, "the payload");
  const LawValue payload(inner.get(), "", name);

  LawFile law;
  ControllerConfig& config = law.config_;
  const LawValue timing = payload.at("timing");
  const double period_s = timing.at("period_s").number_in(kShortestPeriod_s, kLongestPeriod_s);
  config.trigger_on_sync = timing.at("trigger").choice({"encoder", "sync"}) == 1;
  read_model(payload.at("model"), period_s, config.model);
  read_estimator(payload.at("estimator"), period_s, config.estimator);
  const LawValue law_section = payload.at("law");
  read_law(law_section, config, config.law);
  const int np = static_cast<int>(law_section.at("parameter_names").texts().size());
  try {
    law.packing_ = LawPacking(read_law_tables(law_section, np), evaluation);
  } catch (const std::invalid_argument& error) {  // larger than an evaluation can address
    law_section.at("evaluator").fail(std::string("cannot be used: ") + error.what());
  }
  config.law.packed = law.packing_.law();
  read_valve(payload.at("valve"), law_section, config, config.valve);
  read_safety(payload.at("safety"), config, config.safety);
  read_bus(payload.at("bus"), config);
  read_meta(payload, law.meta_);
  config.inputs_crc32 = law.meta_.inputs_crc32;
  return law;
}

}  // namespace eampc::service
