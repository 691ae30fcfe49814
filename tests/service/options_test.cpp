#include "service/options.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <vector>

namespace eampc::service {
namespace {

ParsedOptions parse(std::vector<const char*> arguments) {
  arguments.insert(arguments.begin(), "eampcd");
  return parse_options(static_cast<int>(arguments.size()), arguments.data());
}

TEST(Options, DefaultsAreTheSafeOnes) {
  const Options options = parse({"--law", "a.law", "--bus", "socketcan:can0"}).options;
  EXPECT_EQ(options.law_file, "a.law");
  EXPECT_EQ(options.bus_url, "socketcan:can0");
  EXPECT_FALSE(options.emulation);
  EXPECT_FALSE(options.lockstep);
  EXPECT_FALSE(options.restart_interface);
  EXPECT_EQ(options.realtime.request, realtime::RealtimeRequest::kWarn);
  EXPECT_EQ(options.realtime.cpu, -1);
  EXPECT_TRUE(options.lcm_url.empty());
  EXPECT_EQ(options.ready_fd, -1);
}

TEST(Options, ReadsEveryFlag) {
  const Options options = parse({"--law=a", "--bus=b", "--rig=r", "--socket=/tmp/s", "--emulation",
                                 "--lockstep", "--restart-interface", "--socket-for-group",
                                 "--realtime=enforce", "--cpu=1", "--priority=50", "--lcm-url=none",
                                 "--record=c.csv", "--log-level=error", "--ready-fd=7"})
                              .options;
  EXPECT_EQ(options.rig, "r");
  EXPECT_EQ(options.socket_path, "/tmp/s");
  EXPECT_TRUE(options.lockstep);
  EXPECT_TRUE(options.restart_interface);
  EXPECT_TRUE(options.socket_for_group);
  EXPECT_EQ(options.realtime.request, realtime::RealtimeRequest::kEnforce);
  EXPECT_EQ(options.realtime.cpu, 1);
  EXPECT_EQ(options.realtime.priority, 50);
  EXPECT_EQ(options.lcm_url, "none");
  EXPECT_EQ(options.record_file, "c.csv");
  EXPECT_EQ(options.ready_fd, 7);
}

TEST(Options, RefusesInOneSentence) {
  const std::vector<std::vector<const char*>> wrong{
      {},
      {"--law", "a"},
      {"--bus", "b"},
      {"--law", "a", "--bus", "b", "--bogus"},
      {"--law", "a", "--bus", "b", "stray"},
      {"--law", "a", "--bus", "b", "--priority", "0"},
      {"--law", "a", "--bus", "b", "--cpu", "x"},
      {"--law", "a", "--bus", "b", "--realtime", "maybe"},
      {"--law", "a", "--bus", "b", "--lockstep"},
  };
  for (const auto& arguments : wrong) {
    try {
      parse(arguments);
      ADD_FAILURE() << "accepted";
    } catch (const BadInput& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    }
  }
}

TEST(Options, HelpAndVersionAreTexts) {
  EXPECT_NE(parse({"--help"}).text.find("--lockstep"), std::string::npos);
  EXPECT_EQ(parse({"--version"}).text.rfind("eampcd ", 0), 0u);
}

TEST(Options, SocketPathFollowsTheEnvironment) {
  ::setenv("EAMPC_SOCKET", "/a/b", 1);
  EXPECT_EQ(default_socket_path(), "/a/b");
  ::unsetenv("EAMPC_SOCKET");
  ::setenv("XDG_RUNTIME_DIR", "/run/user/7", 1);
  EXPECT_EQ(default_socket_path(), "/run/user/7/eampcd.sock");
  ::unsetenv("XDG_RUNTIME_DIR");
  EXPECT_EQ(default_socket_path().rfind("/tmp/eampcd-", 0), 0u);
}

}  // namespace
}  // namespace eampc::service
