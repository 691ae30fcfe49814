#include "service/recorder.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "service/options.hpp"

namespace eampc::service {
namespace {

TEST(Recorder, WritesTheAgreedColumns) {
  const std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("recorder_test_" + std::to_string(::getpid()));
  {
    Recorder recorder(path.string());
    realtime::LoopRecord record;
    record.cycle.cycle = 3;
    record.cycle.scenario_time_s = 0.1;
    record.cycle.reference = {0.5, -0.25, 9.0};
    record.cycle.state.x = {0.125, 2.0, 3.0};
    record.cycle.disturbance.for_law = {7.0, 8.0};
    record.cycle.law = {.u = 1.5, .region = 42};
    record.cycle.valves = {4.0, 6.0, true};
    record.cycle.mode = control::Mode::kActive;
    record.cycle.limits = 5;
    record.cycle.fault = control::Fault::kSendRefused;
    record.cycle.present_faults.add(control::Fault::kTxUnconfirmed);
    record.arrival_to_wake_us = 1.25;
    record.wake_to_decided_us = 2.0;
    record.decided_to_sent_us = 3.0;
    record.arrival_to_sent_us = 6.25;
    recorder.write(record);
    EXPECT_TRUE(recorder.close());
  }
  std::ifstream file(path);
  std::string header, line;
  std::getline(file, header);
  std::getline(file, line);
  EXPECT_EQ(
      header,
      "cycle,scenario_time_s,reference_angle_rad,reference_velocity_rad_s,measured_angle_rad,angle_"
      "rad,"
      "velocity_rad_s,valve_control,disturbance_rad_s2,control,u1_V,u2_V,region,mode,fault,present_"
      "faults,limits,"
      "arrival_to_wake_us,wake_to_decided_us,decided_to_sent_us,arrival_to_sent_us");
  EXPECT_EQ(line,
            "3,0.1,0.5,-0.25,nan,0.125,2,3,8,1.5,4,6,42,ACTIVE,send_refused,4096,5,1.25,2,3,6.25");
  std::filesystem::remove(path);
}

TEST(Recorder, RefusesAPathItCannotWrite) {
  EXPECT_THROW(Recorder("/no/such/folder/r.csv"), BadInput);
}

}  // namespace
}  // namespace eampc::service
