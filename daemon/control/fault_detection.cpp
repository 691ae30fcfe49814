#include "control/fault_detection.hpp"

#include <algorithm>
#include <cmath>

#include "control/period_count.hpp"

namespace eampc::control {
namespace {

// Counts on towards `limit`, which it never passes: a node may be silent for months.
void count_up(std::int32_t& periods, std::int32_t elapsed, std::int32_t limit) noexcept {
  periods = std::min(periods + elapsed, limit);
}

}  // namespace

FaultDetection::FaultDetection(const ControllerConfig& config) noexcept
    : config_(config),
      passive_limit_periods_(
          std::max(1, periods_in(config.safety.error_passive_s, config.model.period_s))),
      heartbeat_limit_periods_(
          std::max(1, periods_in(config.safety.heartbeat_timeout_s, config.model.period_s))),
      supply_limit_periods_(
          std::max(1, periods_in(config.safety.supply_pressure_s, config.model.period_s))),
      e_stop_limit_periods_(
          config.e_stop.present && config.safety.e_stop_timeout_s > 0.0
              ? std::max(1, periods_in(config.safety.e_stop_timeout_s, config.model.period_s))
              : 0),
      supply_monitored_(config.valve_feedback.present &&
                        config.valve_feedback.supply_pressure.present &&
                        (std::isfinite(config.safety.supply_pressure_min_kPa) ||
                         std::isfinite(config.safety.supply_pressure_max_kPa))),
      encoder_(config),
      overruns_(periods_in(config.safety.deadline_overruns_window_s, config.model.period_s)),
      silent_node_periods_(heartbeat_limit_periods_),
      doubtful_supply_periods_(supply_limit_periods_),
      silent_e_stop_periods_(e_stop_limit_periods_) {}

FaultSet FaultDetection::check(EncoderSample& sample, const MonitorSample& monitor,
                               const BusHealth& bus, std::int32_t elapsed_periods,
                               const ValveVoltages& sent, bool law_acts) noexcept {
  FaultSet present = encoder_.check(sample, elapsed_periods, sent, law_acts);
  check_bus(bus, elapsed_periods, sent.enable, present);
  check_node(monitor, elapsed_periods, present);
  return present;
}

void FaultDetection::check_bus(const BusHealth& bus, std::int32_t elapsed_periods, bool moving,
                               FaultSet& present) noexcept {
  const SafetyConfig& safety = config_.safety;
  present.add(Fault::kLinkDown, bus.link_down);
  present.add(Fault::kBusOff, bus.bus_off);
  if (bus.error_passive) {
    count_up(passive_periods_, elapsed_periods, passive_limit_periods_);
  } else {
    passive_periods_ = 0;
  }
  present.add(Fault::kErrorPassive, passive_periods_ >= passive_limit_periods_);
  // Nothing enabled leaves before the queue is proved empty: a moving joint gets no command.
  if (moving && !bus.queue_proved_empty) {
    count_up(unproved_periods_, elapsed_periods, safety.tx_unconfirmed_periods);
  } else {
    unproved_periods_ = 0;
  }
  present.add(Fault::kTxUnconfirmed, std::max(bus.unconfirmed_periods, unproved_periods_) >=
                                         safety.tx_unconfirmed_periods);
  refused_frames_ =
      bus.send_refused ? std::min(refused_frames_ + 1, safety.send_refused_frames) : 0;
  present.add(Fault::kSendRefused, refused_frames_ >= safety.send_refused_frames);
  present.add(Fault::kDeadlineOverruns,
              overruns_.add(elapsed_periods, bus.deadline_overruns) > safety.deadline_overruns_max);
}

void FaultDetection::check_node(const MonitorSample& monitor, std::int32_t elapsed_periods,
                                FaultSet& present) noexcept {
  if (monitor.heartbeat_seen) {
    silent_node_periods_ = 0;
  } else {
    count_up(silent_node_periods_, elapsed_periods, heartbeat_limit_periods_);
  }
  present.add(Fault::kHeartbeatLost,
              config_.heartbeat.present && silent_node_periods_ >= heartbeat_limit_periods_);

  if (monitor.feedback_seen && supply_is_good(monitor)) {
    doubtful_supply_periods_ = 0;
  } else {
    count_up(doubtful_supply_periods_, elapsed_periods, supply_limit_periods_);
  }
  present.add(Fault::kSupplyPressure,
              supply_monitored_ && doubtful_supply_periods_ >= supply_limit_periods_);

  // An alarm counts in its own period even if the all-clear came right behind it.
  present.add(Fault::kEmergencyMessage, monitor.emergency);
  emergency_ = (emergency_ || monitor.emergency) && !monitor.emergency_over;
  present.add(Fault::kEmergencyMessage, emergency_);
  present.add(Fault::kEStop, monitor.e_stop);
  e_stop_ = (e_stop_ || monitor.e_stop) && !monitor.e_stop_released;
  present.add(Fault::kEStop, e_stop_);
  if (monitor.e_stop || monitor.e_stop_released) {
    silent_e_stop_periods_ = 0;
  } else {
    count_up(silent_e_stop_periods_, elapsed_periods, e_stop_limit_periods_);
  }
  present.add(Fault::kEStop,
              e_stop_limit_periods_ > 0 && silent_e_stop_periods_ >= e_stop_limit_periods_);
  present.add(Fault::kLawMismatch, monitor.identity_differs);
  law_mismatch_ = (law_mismatch_ || monitor.identity_differs) && !monitor.identity_agrees;
  present.add(Fault::kLawMismatch, law_mismatch_);
}

bool FaultDetection::supply_is_good(const MonitorSample& monitor) const noexcept {
  return monitor.supply_pressure_kPa >= config_.safety.supply_pressure_min_kPa &&
         monitor.supply_pressure_kPa <= config_.safety.supply_pressure_max_kPa;
}

}  // namespace eampc::control
