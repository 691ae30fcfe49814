// The socket, the desk and the loop together; the loop runs in lock-step on a socketpair.
#include "service/operator_socket.hpp"

#include <gtest/gtest.h>
#include <linux/can.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <msgpack.hpp>
#include <optional>
#include <stdexcept>
#include <thread>
#include <vector>

#include "control/encoder_codec.hpp"
#include "realtime/toy_rig.hpp"
#include "service/options.hpp"

namespace eampc::service {
namespace {

class OperatorSocketTest : public ::testing::Test {
 protected:
  OperatorSocketTest() {
    int ends[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
    wire_ = realtime::FileDescriptor(ends[1]);
    bus_.emplace(realtime::CanBus(realtime::FileDescriptor(ends[0]), {testing::kEncoderId, false}));
    loop_ = std::make_unique<realtime::ControlLoop>(*bus_, config_,
                                                    realtime::LoopSettings{.lockstep = true});
    loop_thread_ = std::thread([this] { loop_->run(); });
    DeskSettings settings;
    settings.rig_name = "toy";
    settings.bus_url = "pair";
    desk_ = std::make_unique<OperatorDesk>(*loop_, settings);
    socket_ = std::make_unique<OperatorSocket>(path_, *desk_);
    socket_->start();
  }
  ~OperatorSocketTest() override {
    socket_.reset();
    loop_->request_stop();
    loop_thread_.join();
  }

  struct Reply {
    msgpack::object_handle handle;
    const msgpack::object& at(const std::string& key) const {
      const auto& map = handle->via.map;
      for (std::uint32_t i = 0; i < map.size; ++i) {
        if (map.ptr[i].key.as<std::string>() == key) return map.ptr[i].val;
      }
      throw std::out_of_range(key);
    }
    bool ok() const { return at("ok").as<bool>(); }
    std::string text(const std::string& key) const { return at(key).as<std::string>(); }
  };

  realtime::FileDescriptor connected() const {
    realtime::FileDescriptor fd(::socket(AF_UNIX, SOCK_STREAM, 0));
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strcpy(address.sun_path, path_.c_str());
    EXPECT_EQ(::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    return fd;
  }
  static std::string framed(const std::map<std::string, std::string>& request) {
    msgpack::sbuffer buffer;
    msgpack::pack(buffer, request);
    const auto size = static_cast<std::uint32_t>(buffer.size());
    return std::string(reinterpret_cast<const char*>(&size), 4) +
           std::string(buffer.data(), buffer.size());
  }
  static Reply reply(int fd) {
    std::uint32_t size = 0;
    EXPECT_EQ(::recv(fd, &size, 4, MSG_WAITALL), 4);
    std::string body(size, '\0');
    EXPECT_EQ(::recv(fd, body.data(), size, MSG_WAITALL), static_cast<ssize_t>(size));
    return {msgpack::unpack(body.data(), body.size())};
  }
  Reply ask(const std::string& command) const {
    const realtime::FileDescriptor fd = connected();
    const std::string bytes = framed({{"command", command}});
    EXPECT_EQ(::send(fd.get(), bytes.data(), bytes.size(), 0), static_cast<ssize_t>(bytes.size()));
    return reply(fd.get());
  }
  void put_encoder() {
    const control::Frame frame =
        control::encode_encoder_frame(config_.encoder, 0.0, 0.0, counter_++, 0);
    can_frame raw{};
    raw.can_id = frame.id;
    raw.can_dlc = frame.length;
    std::memcpy(raw.data, frame.data.data(), 8);
    ASSERT_EQ(::send(wire_.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
    ASSERT_EQ(::recv(wire_.get(), &raw, sizeof raw, 0), static_cast<ssize_t>(sizeof raw));
  }

  const std::string path_ =
      (std::filesystem::temp_directory_path() / ("eampc_socket_test_" + std::to_string(::getpid())))
          .string();
  control::ControllerConfig config_ = testing::toy_config(0.001);
  std::uint64_t counter_ = 0;
  realtime::FileDescriptor wire_;
  std::optional<realtime::Bus> bus_;
  std::unique_ptr<realtime::ControlLoop> loop_;
  std::thread loop_thread_;
  std::unique_ptr<OperatorDesk> desk_;
  std::unique_ptr<OperatorSocket> socket_;
};

TEST_F(OperatorSocketTest, OnlyTheOwnerMayOpenIt) {
  struct stat status {};
  ASSERT_EQ(::stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777u, 0600u);
  const std::string shared_path = path_ + ".group";
  const OperatorSocket shared(shared_path, *desk_, 0660);
  ASSERT_EQ(::stat(shared_path.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777u, 0660u);
}

TEST_F(OperatorSocketTest, ArmNeedsAFrameThenReset) {
  EXPECT_FALSE(ask("arm").ok());
  put_encoder();
  std::thread plant([this] {
    for (int i = 0; i < 300; ++i) {
      put_encoder();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  Reply armed = ask("arm");
  EXPECT_TRUE(armed.ok()) << armed.text("message");
  EXPECT_EQ(armed.text("mode"), "ACTIVE");
  EXPECT_FALSE(ask("arm").ok());
  EXPECT_TRUE(ask("disarm").ok());
  plant.join();
  EXPECT_EQ(ask("status").text("mode"), "DISARMED");
}

TEST_F(OperatorSocketTest, ASlowClientDelaysNobody) {
  const realtime::FileDescriptor slow = connected();
  const std::string bytes = framed({{"command", "status"}});
  for (const char byte : bytes.substr(0, 3)) ASSERT_EQ(::send(slow.get(), &byte, 1, 0), 1);
  EXPECT_TRUE(ask("status").ok());
  const std::string rest = bytes.substr(3) + bytes + bytes;  // three requests in one go
  ASSERT_EQ(::send(slow.get(), rest.data(), rest.size(), 0), static_cast<ssize_t>(rest.size()));
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(reply(slow.get()).ok());
}

TEST_F(OperatorSocketTest, AClientThatNeverReadsIsDropped) {
  const realtime::FileDescriptor deaf = connected();
  const std::string bytes = framed({{"command", "status"}});
  bool dropped = false;
  for (int i = 0; i < 100'000 && !dropped; ++i) {
    dropped = ::send(deaf.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL) < 0;
  }
  EXPECT_TRUE(dropped);
  EXPECT_TRUE(ask("status").ok());
}

TEST_F(OperatorSocketTest, TheFileIsTakenOverOnlyFromTheDead) {
  EXPECT_THROW(OperatorSocket(path_, *desk_), BadInput);
  EXPECT_TRUE(ask("status").ok());
  socket_.reset();
  EXPECT_FALSE(std::filesystem::exists(path_));
  {
    const realtime::FileDescriptor dead(::socket(AF_UNIX, SOCK_STREAM, 0));
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strcpy(address.sun_path, path_.c_str());
    ASSERT_EQ(::bind(dead.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  socket_ = std::make_unique<OperatorSocket>(path_, *desk_);
  socket_->start();
  EXPECT_TRUE(ask("status").ok());
}

TEST_F(OperatorSocketTest, ScheduledCommandsDoNotBarADisarm) {
  put_encoder();
  OperatorRequest scheduled;
  scheduled.command = Command::kReset;
  scheduled.at_cycle = std::int64_t{1} << 53;
  int accepted = 0;
  while (accepted < 200 && desk_->answer(scheduled).ok) ++accepted;
  EXPECT_GT(accepted, 0);
  for (int i = 0; i < 5; ++i) put_encoder();
  std::thread plant([this] {
    for (int i = 0; i < 300; ++i) {
      put_encoder();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  EXPECT_EQ(ask("arm").text("mode"), "ACTIVE");
  const Reply disarmed = ask("disarm");
  plant.join();
  EXPECT_TRUE(disarmed.ok());
  EXPECT_NE(disarmed.text("mode"), "ACTIVE") << disarmed.text("message");
}

// Twenty commands in one go, each waiting its 250 ms for a cycle that does not come.
TEST_F(OperatorSocketTest, AFloodOfCommandsDelaysNeitherOthersNorTheStop) {
  const realtime::FileDescriptor flood = connected();
  std::string bytes;
  for (int i = 0; i < 20; ++i) bytes += framed({{"command", "reset"}});
  ASSERT_EQ(::send(flood.get(), bytes.data(), bytes.size(), 0), static_cast<ssize_t>(bytes.size()));
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_TRUE(ask("status").ok());
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(1500));
  socket_->stop();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(3000));
}

TEST_F(OperatorSocketTest, SixteenClientsAndTheSeventeenth) {
  std::vector<realtime::FileDescriptor> clients;
  for (int i = 0; i < 40; ++i) clients.push_back(connected());
  EXPECT_TRUE(ask("status").ok());
}

}  // namespace
}  // namespace eampc::service
