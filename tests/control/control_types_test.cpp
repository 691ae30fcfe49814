#include "control/control_types.hpp"

#include <gtest/gtest.h>

#include <string>
#include <type_traits>

namespace eampc::control {
namespace {

TEST(ControlTypes, EveryFaultAndLimitNamesItsKey) {
  for (std::size_t number = 1; number < kFaultCount; ++number) {
    EXPECT_NE(std::string(fault_text(static_cast<Fault>(number))).find('('), std::string::npos);
  }
  for (const Limit limit : {kLimitControlRange, kLimitSlewRate, kLimitParameterBox,
                            kLimitReferenceRange, kLimitReduced}) {
    EXPECT_NE(std::string(limit_text(limit)).find('('), std::string::npos);
  }
  EXPECT_STREQ(fault_text(Fault::kNone), "none");
}

TEST(ControlTypes, ModesAreWrittenAsInTheDesign) {
  EXPECT_STREQ(mode_text(Mode::kInit), "INIT");
  EXPECT_STREQ(mode_text(Mode::kSoftStop), "SOFT_STOP");
  EXPECT_STREQ(mode_text(Mode::kFault), "FAULT");
}

TEST(ControlTypes, NumbersBeyondTheEnumerationsAreNotFatal) {
  EXPECT_STREQ(fault_text(static_cast<Fault>(250)), "unknown");
  EXPECT_STREQ(mode_text(static_cast<Mode>(250)), "unknown");
}

}  // namespace
}  // namespace eampc::control
