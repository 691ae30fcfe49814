// Any bytes as a law file. First byte odd: the rest is the file; even: the rest is its payload, and
// the container with the right checksum is put around it. A file that is accepted must be safe to
// run: its controller steps through a short story under the invariants of checked_cycle.hpp.
#include <zlib.h>

#include <string>
#include <vector>

#include "fuzz/cycle_script.hpp"
#include "service/law_file.hpp"
#include "service/synthetic_law.hpp"

namespace {

using eampc::service::LawFile;
using eampc::service::LawFileError;

// As the tests' own law file has it: a new version of the format needs no new cases.
std::uint8_t present_version() {
  const std::vector<std::uint8_t> file =
      eampc::service::law_bytes(eampc::service::synthetic_payload());
  const auto container = msgpack::unpack(reinterpret_cast<const char*>(file.data()), file.size());
  std::map<std::string, msgpack::object> entries;
  container->convert(entries);
  return entries.at("version").as<std::uint8_t>();
}

// The header that law_bytes() of the tests writes, with its MessagePack types by hand.
std::vector<std::uint8_t> wrapped(std::span<const std::uint8_t> payload) {
  const auto checksum = static_cast<std::uint32_t>(crc32_z(0, payload.data(), payload.size()));
  std::vector<std::uint8_t> file;
  const auto text = [&](const std::string& value) {
    file.push_back(static_cast<std::uint8_t>(0xa0 | value.size()));
    file.insert(file.end(), value.begin(), value.end());
  };
  const auto big_endian = [&](std::uint8_t type, std::uint32_t value) {
    file.push_back(type);
    for (int shift = 24; shift >= 0; shift -= 8)
      file.push_back(static_cast<std::uint8_t>(value >> shift));
  };
  file.push_back(0x84);
  text("format");
  text("eampc-law");
  text("version");
  static const std::uint8_t version = present_version();
  file.push_back(version);
  text("crc32");
  big_endian(0xce, checksum);
  text("payload");
  big_endian(0xc6, static_cast<std::uint32_t>(payload.size()));
  file.insert(file.end(), payload.begin(), payload.end());
  return file;
}

void run(const LawFile& law) {
  // Good frames through every ramp, an arming in between, a jump, a silence, a disarm.
  static constexpr std::uint8_t kStory[] = {
      2,    20,   1, 6, 1, 2, 255,  1,    2, 255, 255, 3,  0x10, 0x27, 0, 64, 1,   0, 7, 2,
      0x10, 0x27, 0, 0, 0, 0, 0x10, 0x27, 2, 60,  3,   10, 2,    6,    2, 2,  255, 0, 2, 255};
  eampc::fuzz::CycleScript(law.config(), {kStory, sizeof kStory}).run();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  eampc::fuzz::ByteReader bytes(data, size);
  const bool as_it_is = (bytes.take<std::uint8_t>() & 1) != 0;
  const std::span<const std::uint8_t> rest = bytes.rest();
  try {
    run(LawFile::from_bytes(as_it_is ? std::vector(rest.begin(), rest.end()) : wrapped(rest),
                            "fuzz.law"));
  } catch (const LawFileError& error) {
    const std::string sentence = error.what();
    eampc::fuzz::require(sentence.rfind("fuzz.law: ", 0) == 0 && sentence.size() > 20,
                         "a refused law file is named with the reason");
    for (const char c : sentence) {
      eampc::fuzz::require(static_cast<unsigned char>(c) >= ' ', "a refusal is printable");
    }
  }
  return 0;
}
