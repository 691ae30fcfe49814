#include "service/law_file.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <limits>
#include <random>
#include <string>

#include "service/synthetic_law.hpp"

namespace eampc::service {
namespace {

using control::ControllerConfig;

// The sentence of the error, or "" if the file is accepted.
std::string refusal(const std::vector<std::uint8_t>& bytes) {
  try {
    LawFile::from_bytes(bytes, "rig.law");
    return "";
  } catch (const LawFileError& error) {
    return error.what();
  }
}

std::string refusal(const std::function<void(Tree&)>& damage) {
  Tree payload = synthetic_payload();
  damage(payload);
  return refusal(law_bytes(payload));
}

TEST(LawFile, LoadsWhatWasWritten) {
  const LawFile law = LawFile::from_bytes(law_bytes(synthetic_payload()), "rig.law");
  const ControllerConfig& c = law.config();
  EXPECT_EQ(law.meta().rig_name, "synthetic");
  EXPECT_EQ(law.meta().inputs_crc32, 4000000000u);
  EXPECT_EQ(law.meta().statistics.at("seconds"), 0.1);
  EXPECT_EQ(law.meta().parameter_names.size(), 5u);
  EXPECT_EQ(c.model.order, 2);
  EXPECT_EQ(c.model.A_star(1, 0), -1.46);
  EXPECT_EQ(c.model.A_star(2, 2), 0.0);
  EXPECT_EQ(c.model.D(0, 1), 0.000012);
  EXPECT_EQ(c.estimator.D_inverse(1, 0), 150.0);
  // κ = (1 − e^{−aT})/a with e^{−aT} = 0.975.
  EXPECT_NEAR(c.estimator.held_integral_s, 0.005 * 0.025 / -std::log(0.975), 1e-15);
  EXPECT_EQ(c.valve.bias_V, 5.0);  // written as a whole number
  EXPECT_EQ(c.encoder.velocity.start_bit, 24);
  EXPECT_TRUE(c.valve_command.crc.present);
  EXPECT_EQ(c.valve_command.crc.data_id, 0x201);
  EXPECT_TRUE(c.sync.present);
  EXPECT_TRUE(c.sync.counter.present);
  EXPECT_FALSE(c.trigger_on_sync);
  const double p[8] = {0.1, 0.5, 3.0, 0.0, 0.0};
  EXPECT_NEAR(control::evaluate(c.law.packed, p).u, -2.0, 1e-12);
}

TEST(LawFile, TheSafetySectionAndTheMonitoredMessages) {
  const LawFile law = LawFile::from_bytes(law_bytes(synthetic_payload()), "rig.law");
  const ControllerConfig& c = law.config();
  EXPECT_EQ(c.safety.reduced_limits_s, 0.25);
  EXPECT_EQ(c.safety.reduced_control_share, 0.4);
  EXPECT_EQ(c.safety.reduced_slew_V_per_s, 300.0);
  EXPECT_EQ(c.safety.encoder_invalid_frames, 5);
  EXPECT_EQ(c.safety.encoder_frozen_s, 0.1);
  EXPECT_EQ(c.safety.encoder_frozen_command_V, 0.6);
  EXPECT_EQ(c.safety.encoder_jump_velocity_rad_s, 18.0);
  EXPECT_EQ(c.safety.encoder_jump_margin_rad, 0.07);
  EXPECT_EQ(c.safety.encoder_counter_gap_max, 2);
  EXPECT_EQ(c.safety.encoder_status_mask, 12u);
  EXPECT_EQ(c.safety.error_passive_s, 0.3);
  EXPECT_EQ(c.safety.tx_unconfirmed_periods, 3);
  EXPECT_EQ(c.safety.send_refused_frames, 4);
  EXPECT_EQ(c.safety.heartbeat_timeout_s, 0.35);
  EXPECT_EQ(c.safety.e_stop_timeout_s, 0.15);
  EXPECT_EQ(c.safety.supply_pressure_min_kPa, 500.0);
  EXPECT_EQ(c.safety.supply_pressure_max_kPa, std::numeric_limits<double>::infinity());
  EXPECT_EQ(c.safety.supply_pressure_s, 0.2);
  EXPECT_EQ(c.safety.deadline_overruns_max, 7);
  EXPECT_EQ(c.safety.deadline_overruns_window_s, 2.0);
  EXPECT_EQ(c.safety.actions[control::Fault::kEncoderTimeout], control::StopAction::kSoftStop);
  EXPECT_EQ(c.safety.actions[control::Fault::kEncoderCrc], control::StopAction::kVentRamp);
  EXPECT_EQ(c.safety.actions[control::Fault::kEStop], control::StopAction::kImmediate);
  EXPECT_EQ(c.safety.actions[control::Fault::kLawMismatch], control::StopAction::kSaturate);

  EXPECT_TRUE(c.valve_feedback.present);
  EXPECT_EQ(c.valve_feedback.id, 0x182u);
  EXPECT_FALSE(c.valve_feedback.pressure1.present);
  EXPECT_EQ(c.valve_feedback.supply_pressure.start_bit, 32);
  EXPECT_TRUE(c.heartbeat.present);
  EXPECT_EQ(c.heartbeat.length, 1);
  EXPECT_FALSE(c.emergency.present);
  EXPECT_TRUE(c.e_stop.present);
  EXPECT_EQ(c.e_stop.released_raw, 1u);
  EXPECT_FALSE(c.identity.present);
  EXPECT_EQ(c.inputs_crc32, 4000000000u);
}

TEST(LawFile, MovingKeepsTheLaw) {
  LawFile first = LawFile::from_bytes(law_bytes(synthetic_payload()), "rig.law");
  const LawFile second = std::move(first);
  const double p[8] = {0.1, 0.5, 3.0, 0.0, 0.0};
  EXPECT_NEAR(control::evaluate(second.config().law.packed, p).u, -2.0, 1e-12);
}

TEST(LawFile, AFileOnDisk) {
  const std::string path = testing::TempDir() + "law_file_test.law";
  const auto bytes = law_bytes(synthetic_payload());
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  EXPECT_EQ(LawFile::load(path).meta().rig_name, "synthetic");
  std::ofstream(path, std::ios::binary | std::ios::trunc).close();
  EXPECT_THROW(LawFile::load(path), LawFileError);
  std::remove(path.c_str());
  try {
    LawFile::load(path);
    FAIL();
  } catch (const LawFileError& error) {
    EXPECT_NE(std::string(error.what()).find("No such file"), std::string::npos);
  }
}

TEST(LawFile, WhatIsNoRegularFileIsRefused) {
  const std::string pipe = testing::TempDir() + "law_file_test.pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  const std::string large = testing::TempDir() + "law_file_test_large.law";
  std::ofstream(large).close();
  ASSERT_EQ(::truncate(large.c_str(), std::int64_t{1} << 40), 0);
  for (const std::string& path : {testing::TempDir(), std::string("/dev/zero"), pipe, large}) {
    EXPECT_THROW(LawFile::load(path), LawFileError) << path;
  }
  std::remove(pipe.c_str());
  std::remove(large.c_str());
}

TEST(LawFile, TruncationSaysHowMuchIsThere) {
  auto bytes = law_bytes(synthetic_payload());
  const std::string whole = std::to_string(bytes.size());
  bytes.resize(bytes.size() - 100);
  const std::string text = refusal(bytes);
  EXPECT_NE(
      text.find("truncated (got " + std::to_string(bytes.size()) + " of " + whole + " bytes)"),
      std::string::npos)
      << text;
}

TEST(LawFile, EveryTruncationAndEveryFlippedByteIsRefused) {
  const auto bytes = law_bytes(synthetic_payload());
  for (std::size_t size = 0; size < bytes.size(); size += 7) {
    EXPECT_NE(refusal({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size)}), "")
        << size;
  }
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    auto damaged = bytes;
    damaged[i] ^= 0x20;
    EXPECT_NE(refusal(damaged), "") << i;
  }
}

TEST(LawFile, RandomBytesAreRefused) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 20'000; ++i) {
    std::vector<std::uint8_t> bytes(random() % 60);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    ASSERT_NE(refusal(bytes), "");
  }
}

TEST(LawFile, FormatAndVersion) {
  EXPECT_NE(refusal(law_bytes(synthetic_payload(), 2, "other")).find("not a law file"),
            std::string::npos);
  EXPECT_NE(refusal(law_bytes(synthetic_payload(), 2)).find("has version 2, this eampcd reads"),
            std::string::npos);
  EXPECT_NE(refusal(law_bytes(synthetic_payload(), 4)).find("version 4"), std::string::npos);
}

// One defect per row and what its sentence must name.
TEST(LawFile, TableOfDefects) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  struct Row {
    const char* named;
    std::function<void(Tree&)> damage;
  };
  const Row rows[] = {
      {"the section model is missing", [](Tree& t) { t.erase("model"); }},
      {"rig lacks the key name", [](Tree& t) { t["rig"].erase("name"); }},
      {"timing.period_s", [](Tree& t) { t["timing"]["period_s"] = 0.0; }},
      {"timing.period_s", [](Tree& t) { t["timing"]["period_s"] = "fast"; }},
      {"timing.period_s", [](Tree& t) { t["timing"]["period_s"] = 1e-12; }},
      {"timing.period_s", [](Tree& t) { t["timing"]["period_s"] = 1e6; }},
      {"timing.trigger", [](Tree& t) { t["timing"]["trigger"] = "clock"; }},
      {"model.order", [](Tree& t) { t["model"]["order"] = 4; }},
      {"model.order", [](Tree& t) { t["model"]["valve_time_constant_s"] = 0.03; }},
      {"model.valve_time_constant_s", [](Tree& t) { t["model"]["valve_time_constant_s"] = -0.03; }},
      {"model.A_star has the shape 3x3",
       [](Tree& t) { t["model"]["A_star"] = matrix(3, 3, std::vector<double>(9)); }},
      {"model.A_star holds a number",
       [nan](Tree& t) {
         t["model"]["A_star"] = matrix(2, 2, {1, 0, nan, 1});
       }},
      {"model.B.f64", [](Tree& t) { t["model"]["B"] = array<double>({2}, {1.0}); }},
      {"model.b ", [](Tree& t) { t["model"]["b"] = 0; }},
      {"model.b1", [nan](Tree& t) { t["model"]["b1"] = nan; }},
      {"estimator.decay", [](Tree& t) { t["estimator"]["decay"] = 1.5; }},
      {"estimator.low_pass_alpha", [](Tree& t) { t["estimator"]["low_pass_alpha"] = 0.0; }},
      {"estimator.kind", [](Tree& t) { t["estimator"]["kind"] = "guess"; }},
      {"law.formulation", [](Tree& t) { t["law"]["formulation"] = "other"; }},
      {"law.u_max", [](Tree& t) { t["law"]["u_max"] = -20.0; }},
      {"law.u_max lets a valve leave", [](Tree& t) { t["law"]["u_max"] = 12.0; }},
      {"law.upper is below lower at parameter 2",
       [](Tree& t) {
         t["law"]["upper"] = vector({1, 1, -30, 1, 1});
       }},
      {"law.lower has the shape 4",
       [](Tree& t) {
         t["law"]["lower"] = vector({0, 0, 0, 0});
       }},
      {"law.parameter_names", [](Tree& t) { t["law"]["parameter_names"] = Tree::List{"e1"}; }},
      {"valve.max_V", [](Tree& t) { t["valve"]["max_V"] = -1; }},
      {"valve.bias_V", [](Tree& t) { t["valve"]["bias_V"] = 12; }},
      {"valve.safe_V", [](Tree& t) { t["valve"]["safe_V"] = -0.5; }},
      {"valve.control_gain_V", [](Tree& t) { t["valve"]["control_gain_V"] = 0; }},
      {"valve.slew_max_V_per_s", [](Tree& t) { t["valve"]["slew_max_V_per_s"] = -1; }},
      {"counts larger than valve.slew_max_V_per_s",
       [](Tree& t) { t["valve"]["slew_max_V_per_s"] = 0.1; }},
      {"safety.encoder_timeout_s", [](Tree& t) { t["safety"]["encoder_timeout_s"] = 0.001; }},
      {"safety.arming_ramp_s", [](Tree& t) { t["safety"]["arming_ramp_s"] = -1.0; }},
      {"safety.actions.encoder_crc",
       [](Tree& t) { t["safety"]["actions"]["encoder_crc"] = "hope"; }},
      {"safety.actions lacks the key e_stop",
       [](Tree& t) { t["safety"]["actions"].erase("e_stop"); }},
      {"safety lacks the key heartbeat_timeout_s",
       [](Tree& t) { t["safety"].erase("heartbeat_timeout_s"); }},
      {"safety.reduced_control_share", [](Tree& t) { t["safety"]["reduced_control_share"] = 1.5; }},
      {"safety.reduced_slew_V_per_s allows",
       [](Tree& t) { t["safety"]["reduced_slew_V_per_s"] = 0.1; }},
      {"safety.encoder_invalid_frames", [](Tree& t) { t["safety"]["encoder_invalid_frames"] = 0; }},
      {"safety.encoder_status_mask", [](Tree& t) { t["safety"]["encoder_status_mask"] = -1; }},
      {"safety.tx_unconfirmed_periods", [](Tree& t) { t["safety"]["tx_unconfirmed_periods"] = 0; }},
      {"must be above supply_pressure_min_kPa",
       [](Tree& t) { t["safety"]["supply_pressure_max_kPa"] = 400.0; }},
      {"bus.heartbeat.id is that of", [](Tree& t) { t["bus"]["heartbeat"]["id"] = 0x181; }},
      {"bus.valve_feedback.signals.supply_pressure does not fit",
       [](Tree& t) { t["bus"]["valve_feedback"]["length"] = 4; }},
      {"bus.e_stop lacks the key released_raw",
       [](Tree& t) { t["bus"]["e_stop"].erase("released_raw"); }},
      {"bus.e_stop.signals lacks the signal stop",
       [](Tree& t) { t["bus"]["e_stop"]["signals"].erase("stop"); }},
      {"safety.reference_angle_max_rad",
       [](Tree& t) { t["safety"]["reference_angle_max_rad"] = 0.0; }},
      {"bus.encoder.signals lacks the signal angle",
       [](Tree& t) { t["bus"]["encoder"]["signals"].erase("angle"); }},
      {"velocity that the adaptive",
       [](Tree& t) { t["bus"]["encoder"]["signals"].erase("velocity"); }},
      {"bus.encoder.signals.velocity overlaps",
       [](Tree& t) {
         t["bus"]["encoder"]["crc"] = Tree();
         t["bus"]["encoder"]["signals"]["velocity"] = signal(23, 16, true, 1);
       }},
      {"bus.encoder.crc overlaps",
       [](Tree& t) { t["bus"]["encoder"]["signals"]["status"] = signal(56, 4, false, 1); }},
      {"bus.encoder.signals.angle does not fit",
       [](Tree& t) { t["bus"]["encoder"]["length"] = 2; }},
      {"bus.encoder.id", [](Tree& t) { t["bus"]["encoder"]["id"] = 0x800; }},
      {"bus.encoder.length", [](Tree& t) { t["bus"]["encoder"]["length"] = 9; }},
      {"factor is 0",
       [](Tree& t) { t["bus"]["encoder"]["signals"]["angle"] = signal(0, 24, true, 0.0); }},
      {"signals.counter.length",
       [](Tree& t) {
         t["bus"]["encoder"]["signals"]["counter"] = signal(0, 40, false, 1);
         t["bus"]["encoder"]["signals"]["angle"] = signal(40, 8, true, 1);
         t["bus"]["encoder"]["signals"]["velocity"] = signal(48, 8, true, 1);
       }},
      {"bus.valve_command.signals.u1 cannot carry",
       [](Tree& t) { t["bus"]["valve_command"]["signals"]["u1"] = signal(0, 12, true, 0.001); }},
      {"bus.valve_command.id is the encoder's own",
       [](Tree& t) { t["bus"]["valve_command"]["id"] = 0x181; }},
      {"bus.sync.id is that of", [](Tree& t) { t["bus"]["sync"]["id"] = 0x201; }},
      {"bus.sync.id is that of", [](Tree& t) { t["bus"]["sync"]["id"] = 0x181; }},
      {"no sync message",
       [](Tree& t) {
         t["bus"]["sync"] = Tree();
         t["timing"]["trigger"] = "sync";
       }},
      {"telemetry.state_decimation", [](Tree& t) { t["telemetry"]["state_decimation"] = 0; }},
  };
  for (const Row& row : rows) {
    const std::string text = refusal(row.damage);
    EXPECT_NE(text.find(row.named), std::string::npos) << row.named << " <- " << text;
    EXPECT_EQ(text.find("rig.law: "), 0u) << text;
    EXPECT_NE(text.find("design it again"), std::string::npos) << text;
    EXPECT_EQ(text.find('\n'), std::string::npos);
  }
}

TEST(LawFile, KalmanNeedsNoVelocity) {
  Tree payload = synthetic_payload();
  payload["estimator"]["kind"] = "kalman";
  payload["estimator"]["kalman_state_gain"] = vector({0.4, 12.0});
  payload["estimator"]["kalman_disturbance_gain"] = 900;
  payload["bus"]["encoder"]["signals"].erase("velocity");
  const LawFile law = LawFile::from_bytes(law_bytes(payload), "rig.law");
  EXPECT_EQ(law.config().estimator.kalman_state_gain[1], 12.0);
  EXPECT_EQ(law.config().estimator.kalman_disturbance_gain, 900.0);
}

}  // namespace
}  // namespace eampc::service
