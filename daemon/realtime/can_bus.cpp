#include "realtime/can_bus.hpp"

#include <linux/can.h>
#include <linux/can/raw.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>

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

CanBus::CanBus(FileDescriptor fd, const BusFrames& frames) noexcept
    : fd_(std::move(fd)), frames_(frames) {}

SendResult CanBus::send(const control::Frame& frame) noexcept {
  can_frame raw{};
  raw.can_id = can_id({frame.id, frame.extended}) | (frame.remote ? CAN_RTR_FLAG : 0u);
  raw.can_dlc = std::min<std::uint8_t>(frame.length, CAN_MAX_DLEN);
  std::memcpy(raw.data, frame.data.data(), frame.data.size());
  // A full queue must not stop the cycle, and a vanished test peer must not kill the process.
  if (::send(fd_.get(), &raw, sizeof raw, MSG_DONTWAIT | MSG_NOSIGNAL) == sizeof raw) {
    return SendResult::kSent;
  }
  if (errno == ENETDOWN) return SendResult::kLinkDown;
  return errno == ENXIO || errno == ENODEV ? SendResult::kLinkGone : SendResult::kRefused;
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
        return BusEvent::kLinkDown;
      case ENODEV:
      case ENXIO:
        return BusEvent::kLinkGone;
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
  const bool is_error_frame = (raw.can_id & CAN_ERR_FLAG) != 0;
  control::Frame& frame = received.frame;
  frame.extended = !is_error_frame && (raw.can_id & CAN_EFF_FLAG) != 0;
  frame.remote = !is_error_frame && (raw.can_id & CAN_RTR_FLAG) != 0;
  frame.id = raw.can_id & (frame.extended || is_error_frame ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.length = std::min<std::uint8_t>(raw.can_dlc, CAN_MAX_DLEN);
  std::memcpy(frame.data.data(), raw.data, frame.data.size());
  received.arrival_ns = data.arrival_ns;
  if (is_error_frame) return BusEvent::kErrorFrame;
  if ((message.msg_flags & MSG_CONFIRM) != 0) return BusEvent::kConfirmed;
  if (frames_.encoder.matches(frame)) return BusEvent::kFrame;
  received.monitored = frames_.monitored.find(frame);
  if (received.monitored != FrameFilterList::kMax) return BusEvent::kMonitored;
  return frames_.own.find(frame) != FrameFilterList::kMax ? BusEvent::kForeignCommand
                                                          : BusEvent::kIgnored;
}

// The kernel drops a socket's filters with the interface.
bool CanBus::set_filters() const noexcept {
  std::array<can_filter, 1 + 2 * FrameFilterList::kMax> filters{exact_filter(frames_.encoder)};
  std::size_t count = 1;
  for (const FrameFilterList* list : {&frames_.own, &frames_.monitored}) {
    for (std::size_t i = 0; i < list->count; ++i) filters[count++] = exact_filter(list->filter[i]);
  }
  return ::setsockopt(fd_.get(), SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
                      static_cast<socklen_t>(count * sizeof(can_filter))) == 0;
}

bool CanBus::bind_to_interface() const noexcept {
  ifreq request{};
  std::memcpy(request.ifr_name, interface_.data(), interface_.size());
  if (::ioctl(fd_.get(), SIOCGIFINDEX, &request) != 0) return false;
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = request.ifr_ifindex;
  return ::bind(fd_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

bool CanBus::reopen() noexcept { return confirms() && set_filters() && bind_to_interface(); }

CanBus open_can_bus(const std::string& interface, const BusFrames& frames) {
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
  if (::if_nametoindex(interface.c_str()) == 0) {
    throw std::runtime_error(prefix + "no such device; create it with `ip link add dev " +
                             interface + " type vcan` (virtual) or check --bus");
  }

  CanBus bus(std::move(fd), frames);
  std::memcpy(bus.interface_.data(), interface.c_str(), interface.size());
  if (!bus.set_filters()) {
    throw std::runtime_error(prefix + "cannot set CAN_RAW_FILTER: " + std::strerror(errno));
  }
  const can_err_mask_t errors = CAN_ERR_MASK;
  set_option(bus.fd(), SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors,
             "CAN_RAW_ERR_FILTER");
  const int on = 1;
  set_option(bus.fd(), SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on, "CAN_RAW_RECV_OWN_MSGS");
  set_option(bus.fd(), SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on, "SO_TIMESTAMPNS");
  set_option(bus.fd(), SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on, "SO_RXQ_OVFL");
  if (!bus.bind_to_interface()) {
    throw std::runtime_error(prefix + (errno == ENODEV ? "it is not a CAN interface; check --bus"
                                                       : std::strerror(errno)));
  }
  ifreq request{};
  std::memcpy(request.ifr_name, interface.c_str(), interface.size());
  if (::ioctl(bus.fd(), SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) == 0) {
    throw std::runtime_error(prefix + "the interface is down; bring it up with `ip link set " +
                             interface + " up`");
  }
  return bus;
}

}  // namespace eampc::realtime
