#include "realtime/can_link.hpp"

#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>

#include "realtime/file_descriptor.hpp"

namespace eampc::realtime {

std::string restart_link(const std::string& interface) {
  const std::string prefix = "cannot restart " + interface + ": ";
  // The interface's flags are asked for through any socket.
  const FileDescriptor fd(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  ifreq request{};
  if (interface.size() >= sizeof request.ifr_name) return prefix + "no such device";
  std::memcpy(request.ifr_name, interface.c_str(), interface.size());
  if (::ioctl(fd.get(), SIOCGIFFLAGS, &request) != 0) return prefix + std::strerror(errno);
  if ((request.ifr_flags & IFF_UP) == 0)
    return prefix + "it is down; bring it up with `ip link set " + interface + " up`";
  const short up = request.ifr_flags;
  request.ifr_flags = static_cast<short>(up & ~IFF_UP);
  if (::ioctl(fd.get(), SIOCSIFFLAGS, &request) != 0) {
    return prefix + std::strerror(errno) +
           (errno == EPERM ? "; grant CAP_NET_ADMIN or leave --restart-interface out" : "");
  }
  request.ifr_flags = up;
  if (::ioctl(fd.get(), SIOCSIFFLAGS, &request) != 0) {
    return prefix + std::strerror(errno) + "; it is down now, bring it up with `ip link set " +
           interface + " up`";
  }
  return {};
}

}  // namespace eampc::realtime
