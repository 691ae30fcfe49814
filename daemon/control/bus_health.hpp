// What the bus said since the last cycle, as the control cycle reads it. Filled by the real-time
// loop from error frames, socket errors and transmit confirmations; a bus without such reports
// (emulation) leaves the defaults. Absent: sockets, clocks, actions (safety.cpp decides those).
#pragma once

#include <cstdint>

namespace eampc::control {

struct BusHealth {
  bool link_down = false;         // the interface is down or gone
  bool bus_off = false;           // the controller took itself off the bus
  bool error_passive = false;     // an error counter of the controller is above 127
  bool not_acknowledged = false;  // no node acknowledged a frame since the last cycle
  bool send_refused = false;      // the socket refused the last command frame (ENOBUFS and others)
  // Periods the command frame in flight has waited for its confirmation; 0: none is in flight.
  std::int32_t unconfirmed_periods = 0;
  // A frame sent after the last link-up or bus-off was confirmed: no older command can still wait
  // in the interface's queue. Buses that queue nothing are born with true.
  bool queue_proved_empty = false;
  std::int32_t deadline_overruns = 0;  // new ones since the last cycle
};

}  // namespace eampc::control
