// The test is the service manager: it binds the datagram socket.
#include "service/service_manager.hpp"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>

#include "realtime/file_descriptor.hpp"

namespace eampc::service {
namespace {

class ServiceManagerTest : public ::testing::Test {
 protected:
  ServiceManagerTest() { listen(name_); }
  ~ServiceManagerTest() override {
    for (const char* variable : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) {
      ::unsetenv(variable);
    }
    if (name_[0] != '@') ::unlink(name_.c_str());
  }

  void listen(const std::string& name) {
    name_ = name;
    fd_ = realtime::FileDescriptor(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0));
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    if (name[0] == '@') address.sun_path[0] = '\0';
    const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    EXPECT_EQ(::bind(fd_.get(), reinterpret_cast<const sockaddr*>(&address), length), 0);
    ::setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }

  std::string heard() const {
    std::array<char, 256> text;
    const ssize_t size = ::recv(fd_.get(), text.data(), text.size(), 0);
    return size < 0 ? "nothing" : std::string(text.data(), static_cast<std::size_t>(size));
  }

  std::string name_ = "@eampc-service-manager-test-" + std::to_string(::getpid());
  realtime::FileDescriptor fd_{-1};
};

TEST_F(ServiceManagerTest, HearsEachStateAsOneDatagram) {
  const ServiceManager manager = ServiceManager::from_environment();
  EXPECT_TRUE(manager.notify("READY=1\nSTATUS=DISARMED"));
  EXPECT_EQ(heard(), "READY=1\nSTATUS=DISARMED");
  EXPECT_EQ(heard(), "nothing");
}

TEST_F(ServiceManagerTest, MayListenOnAPath) {
  listen(::testing::TempDir() + "notify-" + std::to_string(::getpid()));
  EXPECT_TRUE(ServiceManager::from_environment().notify("STOPPING=1"));
  EXPECT_EQ(heard(), "STOPPING=1");
}

TEST_F(ServiceManagerTest, IsNotInheritedByChildren) {
  const ServiceManager manager = ServiceManager::from_environment();
  EXPECT_EQ(std::getenv("NOTIFY_SOCKET"), nullptr);
  EXPECT_FALSE(ServiceManager::from_environment().notify("READY=1"));
  EXPECT_EQ(heard(), "nothing");
}

TEST_F(ServiceManagerTest, NeverWaitsForAManagerThatDoesNotRead) {
  const ServiceManager manager = ServiceManager::from_environment();
  int delivered = 0;
  while (manager.notify("WATCHDOG=1")) ++delivered;
  EXPECT_GT(delivered, 0);
  EXPECT_EQ(heard(), "WATCHDOG=1");
  EXPECT_TRUE(manager.notify("WATCHDOG=1"));
}

TEST_F(ServiceManagerTest, WatchesOnlyTheProcessItNames) {
  ::setenv("WATCHDOG_USEC", "2000000", 1);
  ::setenv("WATCHDOG_PID", "1", 1);
  EXPECT_FALSE(ServiceManager::from_environment().watchdog().has_value());
  ::setenv("WATCHDOG_USEC", "2000000", 1);
  ::setenv("WATCHDOG_PID", std::to_string(::getpid()).c_str(), 1);
  EXPECT_EQ(ServiceManager::from_environment().watchdog(), std::chrono::seconds(2));
  for (const char* wrong : {"", "0", "-5", "2s", "99999999999999999999"}) {
    ::setenv("WATCHDOG_USEC", wrong, 1);
    EXPECT_FALSE(ServiceManager::from_environment().watchdog().has_value()) << wrong;
  }
}

TEST_F(ServiceManagerTest, IsFedByNothingButTheLoop) {
  ::setenv("WATCHDOG_USEC", "2000000", 1);
  const ServiceManager manager = ServiceManager::from_environment();
  std::uint64_t turns = 0;
  LoopWatchdog watchdog(manager, [&] { return turns; });
  EXPECT_EQ(watchdog.interval(), std::chrono::milliseconds(500));
  EXPECT_FALSE(watchdog.feed());  // the loop has not begun
  EXPECT_EQ(heard(), "nothing");
  turns = 1;
  EXPECT_TRUE(watchdog.feed());
  EXPECT_EQ(heard(), "WATCHDOG=1");
  EXPECT_FALSE(watchdog.feed());  // it hangs
  EXPECT_EQ(heard(), "nothing");
  turns = 9;
  EXPECT_TRUE(watchdog.feed());
}

}  // namespace
}  // namespace eampc::service
