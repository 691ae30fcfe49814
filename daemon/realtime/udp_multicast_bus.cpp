#include "realtime/udp_multicast_bus.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <stdexcept>
#include <utility>

#include "realtime/kernel_stamp.hpp"
#include "realtime/udp_multicast_message.hpp"

namespace eampc::realtime {
namespace {

double seconds_since_epoch() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

UdpMulticastBus::LocalAddresses local_addresses() {
  UdpMulticastBus::LocalAddresses result;
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) != 0) {
    throw std::runtime_error(std::string("cannot list this machine's addresses: ") +
                             std::strerror(errno));
  }
  for (const ifaddrs* entry = list; entry != nullptr && result.count < result.address.size();
       entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_in address{};
    std::memcpy(&address, entry->ifa_addr, sizeof address);
    result.address[result.count++] = address.sin_addr.s_addr;
  }
  ::freeifaddrs(list);
  return result;
}

}  // namespace

UdpMulticastBus::UdpMulticastBus(FileDescriptor fd, const sockaddr_in& group,
                                 const LocalAddresses& local, const BusFrames& frames) noexcept
    : fd_(std::move(fd)), group_(group), local_(local), frames_(frames) {}

SendResult UdpMulticastBus::send(const control::Frame& frame) noexcept {
  UdpMessage message;
  const std::size_t size = pack_udp_message(frame, seconds_since_epoch(), message);
  const ssize_t sent = ::sendto(fd_.get(), message.data(), size, MSG_DONTWAIT | MSG_NOSIGNAL,
                                reinterpret_cast<const sockaddr*>(&group_), sizeof group_);
  if (sent == static_cast<ssize_t>(size)) return SendResult::kSent;
  return errno == ENETDOWN || errno == ENETUNREACH || errno == ENODEV ? SendResult::kLinkDown
                                                                      : SendResult::kRefused;
}

BusEvent UdpMulticastBus::receive(ReceivedFrame& received) noexcept {
  std::array<std::uint8_t, 512>
      buffer;  // a classic frame takes about 160 bytes; longer ones are cut and refused
  sockaddr_in sender{};
  iovec part{buffer.data(), buffer.size()};
  alignas(cmsghdr) std::array<std::byte, kControlBytes> control;
  msghdr message{};
  message.msg_name = &sender;
  message.msg_namelen = sizeof sender;
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = ::recvmsg(fd_.get(), &message, MSG_DONTWAIT);
  if (size < 0) {
    if (errno == ENETDOWN || errno == ENODEV) return BusEvent::kLinkDown;
    return errno == EINTR ? BusEvent::kIgnored : BusEvent::kNothing;
  }
  const ControlData data = read_control_data(message);
  if (data.has_overflows) receive_overflows_ = data.overflows;
  const auto end = local_.address.begin() + static_cast<std::ptrdiff_t>(local_.count);
  if ((message.msg_flags & MSG_TRUNC) != 0 ||
      std::find(local_.address.begin(), end, sender.sin_addr.s_addr) == end) {
    return BusEvent::kIgnored;
  }
  const auto parsed = parse_udp_message(std::span(buffer).first(static_cast<std::size_t>(size)));
  if (!parsed) return BusEvent::kIgnored;
  received.frame = parsed->frame;
  received.arrival_ns = data.arrival_ns;
  if (parsed->is_error_frame) return BusEvent::kErrorFrame;
  if (frames_.encoder.matches(parsed->frame)) return BusEvent::kFrame;
  received.monitored = frames_.monitored.find(parsed->frame);
  return received.monitored != FrameFilterList::kMax ? BusEvent::kMonitored : BusEvent::kIgnored;
}

UdpMulticastBus open_udp_multicast_bus(const std::string& group, std::uint16_t port,
                                       const BusFrames& frames) {
  const std::string prefix =
      "cannot join udp_multicast " + group + ":" + std::to_string(port) + ": ";
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  if (::inet_pton(AF_INET, group.c_str(), &address.sin_addr) != 1 ||
      !IN_MULTICAST(ntohl(address.sin_addr.s_addr))) {
    throw std::runtime_error(
        prefix +
        "this is not an IPv4 multicast address; use one of 224.0.0.0/4 such as "
        "239.74.163.2");
  }
  FileDescriptor fd(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (fd.get() < 0) throw std::runtime_error(prefix + std::strerror(errno));

  const auto set = [&](int level, int option, const auto& value) {
    if (::setsockopt(fd.get(), level, option, &value, sizeof value) != 0) {
      throw std::runtime_error(
          prefix + (errno == ENODEV ? "there is no multicast route; add one with `ip route add " +
                                          group + "/32 dev lo`"
                                    : std::string(std::strerror(errno))));
    }
  };
  const int on = 1, off = 0;
  set(SOL_SOCKET, SO_REUSEADDR, on);
  set(SOL_SOCKET, SO_REUSEPORT, on);
  set(SOL_SOCKET, SO_TIMESTAMPNS, on);
  set(SOL_SOCKET, SO_RXQ_OVFL, on);
  set(IPPROTO_IP, IP_MULTICAST_TTL, off);  // 0: never leaves the machine
  set(IPPROTO_IP, IP_MULTICAST_LOOP, on);
  set(IPPROTO_IP, IP_MULTICAST_ALL, off);
  // Bound to the group, not to every address: a unicast datagram to the port is not a CAN frame.
  if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    throw std::runtime_error(prefix + std::strerror(errno));
  }
  ip_mreqn membership{};
  membership.imr_multiaddr = address.sin_addr;
  set(IPPROTO_IP, IP_ADD_MEMBERSHIP, membership);
  return UdpMulticastBus(std::move(fd), address, local_addresses(), frames);
}

}  // namespace eampc::realtime
