// Reads the kernel's receive stamp (SO_TIMESTAMPNS, CLOCK_REALTIME) and drop count (SO_RXQ_OVFL)
// out of a message's control data.
#pragma once

#include <sys/socket.h>

#include <cstdint>
#include <cstring>
#include <ctime>

namespace eampc::realtime {

// Room for the two control messages asked for, and one more that a kernel might add.
inline constexpr std::size_t kControlBytes =
    CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t)) + CMSG_SPACE(64);

inline constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

struct ControlData {
  std::int64_t arrival_ns = 0;
  std::uint32_t overflows = 0;
  bool has_overflows = false;
};

inline ControlData read_control_data(msghdr& message) noexcept {
  ControlData result;
  for (cmsghdr* header = CMSG_FIRSTHDR(&message); header != nullptr;
       header = CMSG_NXTHDR(&message, header)) {
    if (header->cmsg_level != SOL_SOCKET) continue;
    if (header->cmsg_type == SO_TIMESTAMPNS) {
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(header), sizeof stamp);
      result.arrival_ns = stamp.tv_sec * kNanosecondsPerSecond + stamp.tv_nsec;
    } else if (header->cmsg_type == SO_RXQ_OVFL) {
      std::memcpy(&result.overflows, CMSG_DATA(header), sizeof result.overflows);
      result.has_overflows = true;
    }
  }
  return result;
}

}  // namespace eampc::realtime
