#include "service/flight_recorder.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <msgpack.hpp>
#include <thread>

#include "service/options.hpp"

namespace eampc::service {
namespace {

namespace fs = std::filesystem;

class FlightRecorderTest : public ::testing::Test {
 protected:
  ~FlightRecorderTest() override { fs::remove_all(folder_); }

  FlightSettings settings() const {
    return {.folder = (folder_ / "records").string(),
            .rig_name = "toy",
            .law_sha256 = "ab",
            .bus_url = "pair",
            .period_s = 0.005};
  }

  static realtime::LoopRecord record(std::int64_t cycle, control::Fault fault) {
    realtime::LoopRecord record;
    record.cycle.cycle = cycle;
    record.cycle.fault = fault;
    record.cycle.mode =
        fault == control::Fault::kNone ? control::Mode::kActive : control::Mode::kFault;
    record.cycle.valves = {6.0, 4.0, true};
    return record;
  }

  std::vector<fs::path> files() const {
    std::vector<fs::path> found;
    for (const auto& entry : fs::directory_iterator(folder_ / "records")) {
      found.push_back(entry.path());
    }
    return found;
  }

  struct Content {
    msgpack::object_handle handle;
    std::map<std::string, msgpack::object> map;
    std::vector<std::string> names;
    std::vector<double> data;

    double at(std::size_t row, const std::string& name) const {
      const auto column = std::find(names.begin(), names.end(), name) - names.begin();
      return data.at(row * names.size() + static_cast<std::size_t>(column));
    }
    std::size_t rows() const { return data.size() / names.size(); }
  };

  static Content read(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    Content content;
    content.handle = msgpack::unpack(bytes.data(), bytes.size());
    content.map = content.handle->as<std::map<std::string, msgpack::object>>();
    for (const auto& column :
         content.map.at("columns").as<std::vector<std::map<std::string, std::string>>>()) {
      content.names.push_back(column.at("name"));
    }
    const auto data = content.map.at("data").as<std::map<std::string, msgpack::object>>();
    const auto shape = data.at("shape").as<std::vector<std::size_t>>();
    EXPECT_EQ(shape.at(1), content.names.size());
    content.data.resize(shape.at(0) * shape.at(1));
    EXPECT_EQ(data.at("f64").via.bin.size, content.data.size() * sizeof(double));
    std::memcpy(content.data.data(), data.at("f64").via.bin.ptr, data.at("f64").via.bin.size);
    return content;
  }

  fs::path folder_ = fs::temp_directory_path() / ("flight_" + std::to_string(::getpid()));
};

TEST_F(FlightRecorderTest, AFaultLeavesWhatWasBeforeAndWhatCameBehind) {
  FlightRecorder recorder(settings());
  constexpr int kBefore = 5000;  // more than the ring holds
  for (int k = 0; k < kBefore; ++k) recorder.push(record(k, control::Fault::kNone));
  EXPECT_TRUE(recorder.serve().path.empty());
  for (int k = 0; k < static_cast<int>(FlightRecorder::kCyclesAfterFault); ++k) {
    recorder.push(record(kBefore + k, control::Fault::kEStop));
    EXPECT_TRUE(recorder.serve().path.empty()) << k;
  }
  recorder.push(record(9999, control::Fault::kEStop));
  const FlightFile written = recorder.serve();
  ASSERT_EQ(files().size(), 1u);
  EXPECT_EQ(files()[0], written.path);
  EXPECT_NE(written.path.find("-e_stop.flight"), std::string::npos);

  const Content content = read(written.path);
  EXPECT_EQ(content.map.at("format").as<std::string>(), "eampc-flight");
  EXPECT_EQ(content.map.at("rig_name").as<std::string>(), "toy");
  EXPECT_EQ(content.map.at("fault").as<int>(), 19);
  EXPECT_EQ(content.map.at("period_s").as<double>(), 0.005);
  const auto texts =
      content.map.at("texts").as<std::map<std::string, std::map<std::string, std::string>>>();
  EXPECT_EQ(texts.at("mode").at("3"), "ACTIVE");
  EXPECT_EQ(texts.at("fault").size(), control::kFaultCount);
  EXPECT_EQ(texts.at("limits").at("16"), control::limit_text(control::kLimitReduced));
  ASSERT_EQ(content.rows(), FlightRecorder::kCycles);
  EXPECT_EQ(content.at(content.rows() - 1, "cycle"), 9999.0);
  EXPECT_EQ(content.at(content.rows() - 2, "cycle"), kBefore + 511.0);
  EXPECT_EQ(content.at(0, "cycle"), kBefore + 513.0 - 4096.0);
  EXPECT_EQ(content.at(0, "u1_V"), 6.0);
  EXPECT_TRUE(std::isnan(content.at(0, "measured_angle_rad")));
  EXPECT_EQ(content.at(content.rows() - 1, "fault"), 19.0);
  EXPECT_TRUE(recorder.serve().path.empty());  // once per fault
  EXPECT_TRUE(recorder.finish().path.empty());
}

TEST_F(FlightRecorderTest, TheEndDoesNotWaitForWhatComesBehindAFault) {
  FlightRecorder recorder(settings());
  recorder.push(record(1, control::Fault::kNone));
  recorder.push(record(2, control::Fault::kLinkDown));
  EXPECT_FALSE(recorder.finish().path.empty());
  EXPECT_EQ(read(files().at(0)).rows(), 2u);
}

TEST_F(FlightRecorderTest, EveryFaultAfterAResetHasItsFile) {
  FlightRecorder recorder(settings());
  for (int round = 0; round < 3; ++round) {
    recorder.push(record(round, control::Fault::kNone));
    recorder.push(record(round, control::Fault::kBusOff));
    recorder.finish();
  }
  EXPECT_EQ(files().size(), 3u);  // within one second: the names do not collide
}

TEST_F(FlightRecorderTest, OnRequestFromAnotherThread) {
  FlightRecorder recorder(settings());
  recorder.push(record(7, control::Fault::kNone));
  std::atomic<bool> answered{false};
  FlightFile file;
  std::thread operator_thread([&] {
    file = recorder.write_now(std::chrono::seconds(60));
    answered.store(true);
  });
  while (!answered.load()) recorder.serve();
  operator_thread.join();
  ASSERT_EQ(file.error, "");
  const Content content = read(file.path);
  EXPECT_EQ(content.map.at("reason").as<std::string>(), "request");
  EXPECT_EQ(content.at(0, "cycle"), 7.0);
}

TEST_F(FlightRecorderTest, TheFolderKeepsTheNewestAndNothingElseIsTouched) {
  FlightRecorder recorder(settings());
  std::ofstream(folder_ / "records" / "notes.txt") << "mine";
  for (std::size_t k = 0; k < FlightRecorder::kMostFiles + 5; ++k) {
    recorder.push(record(static_cast<std::int64_t>(k), control::Fault::kNone));
    recorder.push(record(static_cast<std::int64_t>(k), control::Fault::kBusOff));
    recorder.finish();
  }
  EXPECT_EQ(files().size(), FlightRecorder::kMostFiles + 1);
  EXPECT_TRUE(fs::exists(folder_ / "records" / "notes.txt"));
}

TEST_F(FlightRecorderTest, AFolderThatCannotBeIsRefused) {
  FlightSettings wrong = settings();
  wrong.folder = "/proc/eampc/records";
  try {
    FlightRecorder recorder(wrong);
    FAIL();
  } catch (const BadInput& error) {
    EXPECT_NE(std::string(error.what()).find("--flight-folder"), std::string::npos);
  }
}

TEST_F(FlightRecorderTest, WhatCannotBeWrittenIsSaid) {
  FlightRecorder recorder(settings());
  fs::remove_all(folder_ / "records");
  recorder.push(record(1, control::Fault::kBusOff));
  const FlightFile file = recorder.finish();
  EXPECT_TRUE(file.path.empty());
  EXPECT_NE(file.error.find("cannot write the flight record"), std::string::npos);
}

}  // namespace
}  // namespace eampc::service
