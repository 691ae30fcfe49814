#include "realtime/error_frame.hpp"

#include <linux/can/error.h>

#include <algorithm>

namespace eampc::realtime {
namespace {

constexpr std::uint8_t kPassiveBits = CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE;
constexpr std::uint8_t kWarningBits = CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING;
// ISO 11898-1: error passive from 128 on. Written out because older headers have no name for it.
constexpr std::uint8_t kPassiveFrom = 128;
constexpr std::uint8_t kWarningFrom = 96;
// Linux 5.19 added the flag; before, a driver filled the counters in without saying so.
constexpr std::uint32_t kCountersFlag = 0x200u;

}  // namespace

ErrorReport decode_error_frame(const control::Frame& frame) noexcept {
  ErrorReport report;
  const std::uint32_t kind = frame.id;
  report.bus_off = (kind & CAN_ERR_BUSOFF) != 0;
  report.restarted = (kind & CAN_ERR_RESTARTED) != 0;
  // Most drivers report a missing acknowledgement as a bus error in the acknowledgement slot.
  report.not_acknowledged = (kind & CAN_ERR_ACK) != 0 ||
                            ((kind & CAN_ERR_PROT) != 0 && frame.data[3] == CAN_ERR_PROT_LOC_ACK);

  const bool counters_said = (kind & kCountersFlag) != 0;
  if (counters_said || (kind & CAN_ERR_CRTL) != 0) {
    report.transmit_errors = frame.data[6];
    report.receive_errors = frame.data[7];
    report.has_counters =
        counters_said || report.transmit_errors != 0 || report.receive_errors != 0;
  }
  const std::uint8_t higher = std::max(report.transmit_errors, report.receive_errors);
  const bool above = report.has_counters && higher >= kPassiveFrom;
  if ((kind & CAN_ERR_CRTL) != 0) {
    const std::uint8_t bits = frame.data[1];
    report.receive_overflow = (bits & CAN_ERR_CRTL_RX_OVERFLOW) != 0;
    if ((bits & kPassiveBits) != 0 || above) {
      report.state = ErrorState::kPassive;
    } else if ((bits & kWarningBits) != 0) {
      report.state = ErrorState::kWarning;
    } else if ((bits & CAN_ERR_CRTL_ACTIVE) != 0) {
      report.state = ErrorState::kActive;
    }
  } else if (above) {
    report.state = ErrorState::kPassive;
  }
  // A recovery may be told by the counters alone; where nobody says that they are filled in, low
  // ones say nothing.
  if (counters_said && report.state == ErrorState::kUnsaid) {
    report.state = higher >= kWarningFrom ? ErrorState::kWarning : ErrorState::kActive;
  }
  return report;
}

}  // namespace eampc::realtime
