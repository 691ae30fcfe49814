#include "realtime/can_bus.hpp"

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "realtime/kernel_stamp.hpp"

namespace eampc::realtime {
namespace {

constexpr canid_t can_id(FrameFilter filter) noexcept {
  return filter.extended ? (filter.id & CAN_EFF_MASK) | CAN_EFF_FLAG : filter.id & CAN_SFF_MASK;
}

// EFF and RTR belong to the mask: without them 0x181 also matches the extended 0x181 and its remote
// request.
constexpr can_filter exact_filter(FrameFilter filter) noexcept {
  return {can_id(filter),
          (filter.extended ? CAN_EFF_MASK : CAN_SFF_MASK) | CAN_EFF_FLAG | CAN_RTR_FLAG};
}

void set_option(int fd, int level, int option, const void* value, std::size_t size,
                const std::string& what) {
  if (::setsockopt(fd, level, option, value, static_cast<socklen_t>(size)) != 0) {
    throw std::runtime_error("cannot set " + what + " on the CAN socket: " + std::strerror(errno));
  }
}

}  // namespace

CanBus::CanBus(FileDescriptor fd, FrameFilter encoder) noexcept
    : fd_(std::move(fd)), encoder_(encoder) {}

bool CanBus::send(const control::Frame& frame) noexcept {
  can_frame raw{};
  raw.can_id = can_id({frame.id, frame.extended}) | (frame.remote ? CAN_RTR_FLAG : 0u);
  raw.can_dlc = std::min<std::uint8_t>(frame.length, CAN_MAX_DLEN);
  std::memcpy(raw.data, frame.data.data(), frame.data.size());
  // A full queue must not stop the cycle, and a vanished test peer must not kill the process.
  return ::send(fd_.get(), &raw, sizeof raw, MSG_DONTWAIT | MSG_NOSIGNAL) == sizeof raw;
}

BusEvent CanBus::receive(ReceivedFrame& received) noexcept {
  can_frame raw{};
  iovec part{&raw, sizeof raw};
  alignas(cmsghdr) std::array<std::byte, kControlBytes> control;
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = ::recvmsg(fd_.get(), &message, MSG_DONTWAIT);
  if (size < 0) {
    switch (errno) {
      case ENETDOWN:
      case ENODEV:
      case ENXIO:
        return BusEvent::kLinkDown;
      case EINTR:
        return BusEvent::kIgnored;
      default:
        return BusEvent::kNothing;
    }
  }
  if (size == 0) return BusEvent::kNothing;  // the peer of a socketpair is gone
  const ControlData data = read_control_data(message);
  if (data.has_overflows) receive_overflows_ = data.overflows;
  if (size != sizeof raw) return BusEvent::kIgnored;
  if ((raw.can_id & CAN_ERR_FLAG) != 0) return BusEvent::kErrorFrame;
  if ((message.msg_flags & MSG_CONFIRM) != 0) return BusEvent::kConfirmed;
  if ((raw.can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG | CAN_EFF_MASK)) != can_id(encoder_)) {
    return BusEvent::kIgnored;
  }
  received.frame.id = encoder_.id;
  received.frame.extended = encoder_.extended;
  received.frame.remote = false;
  received.frame.length = std::min<std::uint8_t>(raw.can_dlc, CAN_MAX_DLEN);
  std::memcpy(received.frame.data.data(), raw.data, received.frame.data.size());
  received.arrival_ns = data.arrival_ns;
  return BusEvent::kFrame;
}

CanBus open_can_bus(const std::string& interface, FrameFilter encoder,
                    std::span<const FrameFilter> own) {
  const std::string prefix = "cannot open CAN interface " + interface + ": ";
  FileDescriptor fd(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW));
  if (fd.get() < 0) {
    if (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT) {
      throw std::runtime_error(prefix +
                               "this kernel has no SocketCAN; load the modules can and can_raw, or "
                               "use --bus udp_multicast: "
                               "for emulation");
    }
    throw std::runtime_error(prefix + std::strerror(errno));
  }
  if (interface.empty() || interface.size() >= IFNAMSIZ) {
    throw std::runtime_error(prefix +
                             "the name of an interface has 1 to 15 characters; check --bus");
  }
  const unsigned index = ::if_nametoindex(interface.c_str());
  if (index == 0) {
    throw std::runtime_error(prefix + "no such device; create it with `ip link add dev " +
                             interface + " type vcan` (virtual) or check --bus");
  }

  std::vector<can_filter> filters{exact_filter(encoder)};
  for (const FrameFilter filter : own) filters.push_back(exact_filter(filter));
  set_option(fd.get(), SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
             filters.size() * sizeof(can_filter), "CAN_RAW_FILTER");
  const can_err_mask_t errors = CAN_ERR_MASK;
  set_option(fd.get(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors,
             "CAN_RAW_ERR_FILTER");
  const int on = 1;
  set_option(fd.get(), SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on, "CAN_RAW_RECV_OWN_MSGS");
  set_option(fd.get(), SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on, "SO_TIMESTAMPNS");
  set_option(fd.get(), SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on, "SO_RXQ_OVFL");

  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(index);
  if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    throw std::runtime_error(prefix + (errno == ENODEV ? "it is not a CAN interface; check --bus"
                                                       : std::strerror(errno)));
  }
  ifreq request{};
  std::memcpy(request.ifr_name, interface.c_str(), interface.size());
  if (::ioctl(fd.get(), SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) == 0) {
    throw std::runtime_error(prefix + "the interface is down; bring it up with `ip link set " +
                             interface + " up`");
  }
  return CanBus(std::move(fd), encoder);
}

}  // namespace eampc::realtime
