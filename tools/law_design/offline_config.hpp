// The daemon's configuration for a loop without a bus: an encoder and two valves, and no node that
// sends heartbeats, feedback or alarms. Their faults do not exist there.
#pragma once

#include "control/controller_config.hpp"

namespace eampc::law_design {

// The packed law still points into the law file's storage.
inline control::ControllerConfig offline_config(control::ControllerConfig config) {
  config.valve_feedback.present = false;
  config.heartbeat.present = false;
  config.emergency.present = false;
  config.e_stop.present = false;
  config.identity.present = false;
  return config;
}

}  // namespace eampc::law_design
