#include "realtime/error_frame.hpp"

#include <linux/can/error.h>

namespace eampc::realtime {
namespace {

constexpr std::uint8_t kPassiveBits = CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE;
constexpr std::uint8_t kWarningBits = CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING;
// ISO 11898-1: error passive from 128 on. Written out because older headers have no name for it.
constexpr std::uint8_t kPassiveFrom = 128;
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
  const bool above = report.has_counters && (report.transmit_errors >= kPassiveFrom ||
                                             report.receive_errors >= kPassiveFrom);
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
  return report;
}

}  // namespace eampc::realtime
