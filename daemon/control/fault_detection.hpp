// In: encoder causes, monitored messages, the bus's health, periods passed → out: every cause of
// the fault matrix that holds in this cycle. Thresholds are those of section [safety]; times are
// counted in periods. Cost: constant. Absent: latches and actions (mode_machine), any clock.
#pragma once

#include "control/bus_health.hpp"
#include "control/controller_config.hpp"
#include "control/encoder_supervision.hpp"
#include "control/monitor_codec.hpp"
#include "control/overrun_window.hpp"

namespace eampc::control {

class FaultDetection {
 public:
  explicit FaultDetection(const ControllerConfig& config) noexcept;

  // `sample` as EncoderSupervision::check; `sent`: the last command, the
  // law's if `law_acts`.
  FaultSet check(EncoderSample& sample, const MonitorSample& monitor, const BusHealth& bus,
                 std::int32_t elapsed_periods, const ValveVoltages& sent, bool law_acts) noexcept;

 private:
  void check_bus(const BusHealth& bus, std::int32_t elapsed_periods, bool moving,
                 FaultSet& present) noexcept;
  void check_node(const MonitorSample& monitor, std::int32_t elapsed_periods,
                  FaultSet& present) noexcept;
  bool supply_is_good(const MonitorSample& monitor) const noexcept;

  const ControllerConfig& config_;
  const std::int32_t passive_limit_periods_;
  const std::int32_t heartbeat_limit_periods_;
  const std::int32_t supply_limit_periods_;
  const std::int32_t e_stop_limit_periods_;  // 0: not watched
  const bool supply_monitored_;

  EncoderSupervision encoder_;
  OverrunWindow overruns_;
  std::int32_t passive_periods_ = 0;
  std::int32_t unproved_periods_ = 0;
  std::int32_t refused_frames_ = 0;
  std::int32_t silent_node_periods_;  // from the start: a node never heard is lost
  std::int32_t doubtful_supply_periods_;
  std::int32_t silent_e_stop_periods_;
  bool emergency_ = false;
  bool e_stop_ = false;
  bool law_mismatch_ = false;
};

}  // namespace eampc::control
