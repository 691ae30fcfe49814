// Expected readings are written down from linux/can/error.h and from what sja1000 and flexcan send.
#include "realtime/error_frame.hpp"

#include <gtest/gtest.h>
#include <linux/can.h>
#include <linux/can/error.h>

#include <array>
#include <random>

namespace eampc::realtime {
namespace {

control::Frame error_frame(std::uint32_t kind, std::array<std::uint8_t, 8> data = {}) {
  control::Frame frame;
  frame.id = kind;
  frame.length = 8;
  frame.data = data;
  return frame;
}

TEST(ErrorFrame, BusOffAndRestart) {
  const ErrorReport off = decode_error_frame(error_frame(CAN_ERR_BUSOFF));
  EXPECT_TRUE(off.bus_off);
  EXPECT_FALSE(off.restarted);
  EXPECT_EQ(off.state, ErrorState::kUnsaid);
  const ErrorReport back = decode_error_frame(error_frame(CAN_ERR_RESTARTED));
  EXPECT_TRUE(back.restarted);
  EXPECT_FALSE(back.bus_off);
}

TEST(ErrorFrame, StatesOfTheController) {
  struct Case {
    std::uint8_t bits;
    ErrorState state;
  };
  for (const Case expected :
       {Case{CAN_ERR_CRTL_RX_WARNING, ErrorState::kWarning},
        Case{CAN_ERR_CRTL_TX_WARNING, ErrorState::kWarning},
        Case{CAN_ERR_CRTL_RX_PASSIVE, ErrorState::kPassive},
        Case{CAN_ERR_CRTL_TX_PASSIVE, ErrorState::kPassive},
        Case{CAN_ERR_CRTL_TX_PASSIVE | CAN_ERR_CRTL_RX_WARNING, ErrorState::kPassive},
        Case{CAN_ERR_CRTL_ACTIVE, ErrorState::kActive},
        Case{CAN_ERR_CRTL_UNSPEC, ErrorState::kUnsaid},
        Case{CAN_ERR_CRTL_RX_OVERFLOW, ErrorState::kUnsaid}}) {
    const ErrorReport report =
        decode_error_frame(error_frame(CAN_ERR_CRTL, {0, expected.bits, 0, 0, 0, 0, 0, 0}));
    EXPECT_EQ(report.state, expected.state) << int{expected.bits};
    EXPECT_EQ(report.receive_overflow, expected.bits == CAN_ERR_CRTL_RX_OVERFLOW);
  }
}

TEST(ErrorFrame, CountersSayPassiveToo) {
  const ErrorReport above =
      decode_error_frame(error_frame(CAN_ERR_CRTL, {0, 0, 0, 0, 0, 0, 128, 3}));
  EXPECT_EQ(above.state, ErrorState::kPassive);
  EXPECT_TRUE(above.has_counters);
  EXPECT_EQ(above.transmit_errors, 128);
  EXPECT_EQ(above.receive_errors, 3);
  const ErrorReport flagged =
      decode_error_frame(error_frame(0x200u | CAN_ERR_PROT, {0, 0, 0, 0, 0, 0, 127, 127}));
  EXPECT_TRUE(flagged.has_counters);
  EXPECT_EQ(flagged.state, ErrorState::kWarning);
  // Bytes 6 and 7 of an arbitration report are nobody's counters.
  EXPECT_FALSE(
      decode_error_frame(error_frame(CAN_ERR_LOSTARB, {0, 0, 0, 0, 0, 0, 200, 200})).has_counters);
}

TEST(ErrorFrame, CountersAloneTellARecoveryWhereTheyAreSaidToBeFilledIn) {
  const auto state = [](std::uint32_t kind, std::uint8_t detail, std::uint8_t errors) {
    return decode_error_frame(error_frame(kind, {0, detail, 0, 0, 0, 0, errors, 0})).state;
  };
  EXPECT_EQ(state(0x200u, 0, 95), ErrorState::kActive);
  EXPECT_EQ(state(0x200u, 0, 96), ErrorState::kWarning);
  EXPECT_EQ(state(0x200u, 0, 128), ErrorState::kPassive);
  EXPECT_EQ(state(0x200u | CAN_ERR_CRTL, CAN_ERR_CRTL_UNSPEC, 95), ErrorState::kActive);
  EXPECT_EQ(state(0x200u | CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE, 95), ErrorState::kPassive);
  EXPECT_EQ(state(CAN_ERR_CRTL, CAN_ERR_CRTL_UNSPEC, 95), ErrorState::kUnsaid);
}

TEST(ErrorFrame, AMissingAcknowledgementHasTwoForms) {
  EXPECT_TRUE(decode_error_frame(error_frame(CAN_ERR_ACK)).not_acknowledged);
  EXPECT_TRUE(decode_error_frame(error_frame(CAN_ERR_PROT | CAN_ERR_BUSERROR,
                                             {0, 0, 0, CAN_ERR_PROT_LOC_ACK, 0, 0, 0, 0}))
                  .not_acknowledged);
  EXPECT_FALSE(decode_error_frame(error_frame(CAN_ERR_PROT | CAN_ERR_BUSERROR,
                                              {0, 0, 0, CAN_ERR_PROT_LOC_DATA, 0, 0, 0, 0}))
                   .not_acknowledged);
  EXPECT_FALSE(
      decode_error_frame(error_frame(CAN_ERR_BUSERROR, {0, 0, 0, CAN_ERR_PROT_LOC_ACK, 0, 0, 0, 0}))
          .not_acknowledged);
}

TEST(ErrorFrame, AnyBitsAreReadWithoutContradiction) {
  std::mt19937 random(20260714);
  for (int i = 0; i < 100'000; ++i) {
    control::Frame frame = error_frame(random() & CAN_EFF_MASK);
    for (std::uint8_t& byte : frame.data) byte = static_cast<std::uint8_t>(random());
    const ErrorReport report = decode_error_frame(frame);
    EXPECT_EQ(report.bus_off, (frame.id & 0x40u) != 0);
    if (report.has_counters && (frame.data[6] > 127 || frame.data[7] > 127)) {
      EXPECT_EQ(report.state, ErrorState::kPassive);
    }
  }
}

}  // namespace
}  // namespace eampc::realtime
