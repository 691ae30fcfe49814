// The section safety of a law file: thresholds and actions of the fault matrix.
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>

#include "service/law_sections.hpp"

namespace eampc::service {
namespace {

// 3.6e7 of the shortest periods: several such ramps still count in 32 bits.
constexpr double kLongest_s = 3600.0;
constexpr int kMostCounts = 1'000'000;

void read_actions(const LawValue& actions, control::FaultActions& out) {
  for (std::size_t number = 1; number < control::kFaultCount; ++number) {
    const auto fault = static_cast<control::Fault>(number);
    out[fault] = static_cast<control::StopAction>(
        actions.at(control::fault_name(fault))
            .choice({"saturate", "soft_stop", "vent_ramp", "immediate"}));
  }
}

}  // namespace

void read_safety(const LawValue& safety, const control::ControllerConfig& config,
                 control::SafetyConfig& out) {
  const double period_s = config.model.period_s;
  const auto time = [&](const char* key) { return safety.at(key).number_in(0.0, kLongest_s); };
  const auto count = [&](const char* key, int lower) {
    return safety.at(key).small_integer(lower, kMostCounts);
  };

  out.encoder_timeout_s = safety.at("encoder_timeout_s").number_in(period_s, kLongest_s);
  out.arming_ramp_s = time("arming_ramp_s");
  out.soft_stop_ramp_s = time("soft_stop_ramp_s");
  out.reduced_limits_s = time("reduced_limits_s");
  out.reduced_control_share =
      safety.at("reduced_control_share").number_in(std::numeric_limits<double>::min(), 1.0);
  out.reduced_slew_V_per_s = safety.at("reduced_slew_V_per_s").positive();

  out.encoder_invalid_frames = count("encoder_invalid_frames", 1);
  out.encoder_frozen_s = time("encoder_frozen_s");
  out.encoder_frozen_command_V = safety.at("encoder_frozen_command_V").positive();
  out.encoder_jump_velocity_rad_s = safety.at("encoder_jump_velocity_rad_s").positive();
  out.encoder_jump_margin_rad = safety.at("encoder_jump_margin_rad").positive();
  out.encoder_counter_gap_max = count("encoder_counter_gap_max", 0);
  out.encoder_status_mask =
      static_cast<std::uint32_t>(safety.at("encoder_status_mask").integer(0, 0xFFFFFFFF));

  out.error_passive_s = time("error_passive_s");
  out.tx_unconfirmed_periods = count("tx_unconfirmed_periods", 1);
  out.send_refused_frames = count("send_refused_frames", 1);
  out.heartbeat_timeout_s = safety.at("heartbeat_timeout_s").number_in(period_s, kLongest_s);
  out.e_stop_timeout_s = time("e_stop_timeout_s");
  if (const auto limit = safety.find("supply_pressure_min_kPa")) {
    out.supply_pressure_min_kPa = limit->number();
  }
  if (const auto limit = safety.find("supply_pressure_max_kPa")) {
    out.supply_pressure_max_kPa = limit->number();
    if (!(out.supply_pressure_min_kPa < out.supply_pressure_max_kPa)) {
      limit->fail("must be above supply_pressure_min_kPa");
    }
  }
  out.supply_pressure_s = time("supply_pressure_s");
  out.deadline_overruns_max = count("deadline_overruns_max", 0);
  out.deadline_overruns_window_s =
      safety.at("deadline_overruns_window_s").number_in(period_s, kLongest_s);

  read_actions(safety.at("actions"), out.actions);
  out.reference_angle_max_rad = safety.at("reference_angle_max_rad").positive();
}

}  // namespace eampc::service
