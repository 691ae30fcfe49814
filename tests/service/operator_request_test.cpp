#include "service/operator_request.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <msgpack.hpp>
#include <random>

#include "service/options.hpp"

namespace eampc::service {
namespace {

using Packer = msgpack::packer<msgpack::sbuffer>;

std::vector<std::uint8_t> packed(const std::function<void(Packer&)>& write) {
  msgpack::sbuffer buffer;
  Packer packer(buffer);
  write(packer);
  return {reinterpret_cast<const std::uint8_t*>(buffer.data()),
          reinterpret_cast<const std::uint8_t*>(buffer.data()) + buffer.size()};
}

template <typename... Entries>
std::vector<std::uint8_t> request(Entries... entries) {
  return packed([&](Packer& packer) {
    packer.pack_map(sizeof...(entries) / 2);
    (packer.pack(entries), ...);
  });
}

std::vector<std::uint8_t> table_request(std::size_t rows, double value) {
  return packed([&](Packer& packer) {
    const std::vector<double> numbers(3 * rows, value);
    packer.pack_map(4);
    packer.pack("command");
    packer.pack("reference");
    packer.pack("kind");
    packer.pack("table");
    packer.pack("sample_period_s");
    packer.pack(0.005);
    packer.pack("table");
    const auto size = static_cast<std::uint32_t>(numbers.size() * sizeof(double));
    packer.pack_bin(size);
    packer.pack_bin_body(reinterpret_cast<const char*>(numbers.data()), size);
  });
}

TEST(OperatorRequest, ReadsCommands) {
  EXPECT_EQ(parse_request(request("command", "status")).command, Command::kStatus);
  const OperatorRequest arm = parse_request(request("command", "arm", "at_cycle", 20));
  EXPECT_EQ(arm.command, Command::kArm);
  EXPECT_EQ(arm.at_cycle, 20);
  EXPECT_EQ(parse_request(request("command", "arm", "at_cycle", -1)).at_cycle, -1);
}

TEST(OperatorRequest, ReadsReferences) {
  const OperatorRequest sine =
      parse_request(request("command", "reference", "kind", "sine", "amplitude_rad", 0.5,
                            "frequency_hz", 1, "start_s", 2.5, "offset_rad", -0.1));
  EXPECT_EQ(sine.reference.kind, control::ReferenceKind::kSine);
  EXPECT_EQ(sine.reference.amplitude_rad, 0.5);
  EXPECT_EQ(sine.reference.frequency_hz, 1.0);
  EXPECT_EQ(sine.reference.start_s, 2.5);
  EXPECT_EQ(sine.reference.offset_rad, -0.1);
  const OperatorRequest table = parse_request(table_request(1000, 0.25));
  ASSERT_EQ(table.table.size(), 1000u);
  EXPECT_EQ(table.table[999].acceleration_rad_s2, 0.25);
}

TEST(OperatorRequest, RefusesWhatItCannotMean) {
  const std::vector<std::vector<std::uint8_t>> wrong{
      {},
      {0xc1},
      request(),
      request("command", 1),
      request("command", "explode"),
      request("command", "arm", "at_cycle", -2),
      request("command", "arm", "at_cycle", 1.5),
      request("command", "arm", "at_cycle", UINT64_MAX),
      request("command", "status", "colour", "red"),
      request("command", "reference"),
      request("command", "reference", "kind", "external"),
      request("command", "reference", "kind", "sine", "amplitude_rad", std::nan("")),
      request("command", "reference", "kind", "sine", "amplitude_rad", 1e300),
      request("command", "reference", "kind", "sine", "frequency_hz", -1.0),
      request("command", "reference", "kind", "table"),
      request("command", "reference", "kind", "step", "amplitude_rad", "0.5"),
      table_request(0, 0.0),
      table_request(10, INFINITY),
      table_request(kMaxTableRows + 1, 0.0),
  };
  for (std::size_t i = 0; i < wrong.size(); ++i) {
    EXPECT_THROW(parse_request(wrong[i]), BadInput) << "case " << i;
  }
}

// Found by fuzzing: a NUL in a foreign key ended the sentence after it.
TEST(OperatorRequest, TellsAForeignKeyWhateverItsBytes) {
  try {
    parse_request(request("command", "status", std::string("a\0\n\xff", 4), 1));
    FAIL() << "a foreign key was accepted";
  } catch (const BadInput& error) {
    EXPECT_STREQ(error.what(), "\"a???\" is not a key of the operator protocol");
  }
}

TEST(OperatorRequest, SurvivesAnyChangedByte) {
  const std::vector<std::uint8_t> whole = table_request(4, 0.5);
  std::mt19937 random(1);
  for (int i = 0; i < 100'000; ++i) {
    std::vector<std::uint8_t> bytes = whole;
    for (std::size_t j = 0; j < 1 + random() % 3; ++j) {
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    }
    bytes.resize(random() % 8 == 0 ? random() % bytes.size() : bytes.size());
    try {
      for (const control::Reference& row : parse_request(bytes).table) {
        EXPECT_TRUE(std::isfinite(row.angle_rad));
      }
    } catch (const BadInput&) {
    }
  }
}

TEST(OperatorReply, IsAMapWithItsLengthInFront) {
  OperatorReply reply;
  reply.message = "done";
  reply.newest.cycle.cycle = 7;
  reply.counters.encoder_timeouts = 2;
  reply.counters.superseded_frames = 3;
  const std::vector<std::uint8_t> message = pack_reply(reply);
  std::uint32_t size = 0;
  std::memcpy(&size, message.data(), 4);
  ASSERT_EQ(size, message.size() - 4);
  const auto handle = msgpack::unpack(reinterpret_cast<const char*>(message.data()) + 4, size);
  std::map<std::string, msgpack::object> map;
  handle.get().convert(map);
  EXPECT_TRUE(map.at("ok").as<bool>());
  EXPECT_EQ(map.at("message").as<std::string>(), "done");
  EXPECT_EQ(map.at("cycle").as<int>(), 7);
  EXPECT_EQ(map.at("mode").as<std::string>(), "INIT");
  EXPECT_EQ((map.at("counters").as<std::map<std::string, std::int64_t>>()).at("missed_cycles"), 5);
}

}  // namespace
}  // namespace eampc::service
