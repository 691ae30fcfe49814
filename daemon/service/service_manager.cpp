#include "service/service_manager.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "realtime/file_descriptor.hpp"

namespace eampc::service {
namespace {

std::string take_variable(const char* name) {
  const char* value = std::getenv(name);
  std::string text = value == nullptr ? "" : value;
  ::unsetenv(name);
  return text;
}

std::optional<std::int64_t> number_in(std::string_view text) {
  std::int64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

}  // namespace

ServiceManager ServiceManager::from_environment() {
  ServiceManager manager;
  manager.address_ = take_variable("NOTIFY_SOCKET");
  const std::optional<std::int64_t> patience_us = number_in(take_variable("WATCHDOG_USEC"));
  const std::string watched = take_variable("WATCHDOG_PID");
  const bool meant_for_us = watched.empty() || number_in(watched) == ::getpid();
  if (patience_us.value_or(0) > 0 && meant_for_us) {
    manager.watchdog_ = std::chrono::microseconds(*patience_us);
  }
  return manager;
}

bool ServiceManager::notify(const std::string& state) const noexcept {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (address_.empty() || address_.size() >= sizeof address.sun_path) return false;
  std::memcpy(address.sun_path, address_.data(), address_.size());
  if (address.sun_path[0] == '@') address.sun_path[0] = '\0';
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  const realtime::FileDescriptor fd(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  return ::sendto(fd.get(), state.data(), state.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                  reinterpret_cast<const sockaddr*>(&address),
                  length) == static_cast<ssize_t>(state.size());
}

bool LoopWatchdog::feed() {
  const std::uint64_t turns = turns_();
  if (turns == last_turns_) return false;
  last_turns_ = turns;
  return manager_.notify("WATCHDOG=1");
}

std::chrono::milliseconds LoopWatchdog::interval() const noexcept {
  using std::chrono::milliseconds;
  if (!manager_.watchdog()) return milliseconds(1000);
  return std::max(milliseconds(1),
                  std::chrono::duration_cast<milliseconds>(*manager_.watchdog() / 4));
}

}  // namespace eampc::service
