// Stage 1b. In: the frames of the monitored messages, as they arrive → out, once per period: node
// alive, pressures kPa, alarms. An emergency or E-stop frame that cannot be decoded (length, CRC)
// counts as the alarm; a heartbeat, feedback or identity that cannot counts as none. An alarm is
// never overwritten by an all-clear of the same period. Cost: one CRC-8 and one to three signals
// per frame. Absent: any opinion on how long a silence may last (fault_detection).
#pragma once

#include "control/controller_config.hpp"

namespace eampc::control {

// What the monitored messages said since the last period.
struct MonitorSample {
  bool feedback_seen = false;
  double pressure1_kPa = 0.0;  // of the newest feedback ever; 0 before
  double pressure2_kPa = 0.0;
  double supply_pressure_kPa = 0.0;
  bool heartbeat_seen = false;   // of a node that is operational
  bool emergency = false;        // an error was reported since the last period
  bool emergency_over = false;   // the newest word on it: no error, or the node has started anew
  bool e_stop = false;           // pressed at any time since the last period
  bool e_stop_released = false;  // the newest word on it
  bool identity_differs = false;
  bool identity_agrees = false;
};

class MonitorCodec {
 public:
  explicit MonitorCodec(const ControllerConfig& config) noexcept : config_(config) {}

  // A heartbeat of a node that has not been started.
  bool asks_for_start(const Frame& frame) const noexcept;
  // A frame of no monitored message is ignored.
  void observe(const Frame& frame) noexcept;
  // The sample of the period that ends now; the next one begins.
  MonitorSample take() noexcept;

 private:
  const ControllerConfig& config_;
  MonitorSample sample_;
};

}  // namespace eampc::control
