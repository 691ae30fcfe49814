// The system calls that the real-time thread may make, and why. Declared once more as nonblocking:
// every other call that leaves our code is a finding of -Wfunction-effects. The same names stand in
// realtime_sanitizer.supp.
#pragma once

#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>

#include <cerrno>

#define EAMPC_ALLOWED [[clang::nonblocking]]
extern "C" {
// Waiting for the frame or the grid point is the loop's purpose.
int ppoll(pollfd*, nfds_t, const timespec*, const sigset_t*) EAMPC_ALLOWED;
int clock_nanosleep(clockid_t, int, const timespec*, timespec*) EAMPC_ALLOWED;
// Read from the vDSO.
int clock_gettime(clockid_t, timespec*) noexcept EAMPC_ALLOWED;
// With MSG_DONTWAIT: one frame in or out, or EAGAIN.
ssize_t recvmsg(int, msghdr*, int) EAMPC_ALLOWED;
ssize_t send(int, const void*, size_t, int) EAMPC_ALLOWED;
ssize_t sendto(int, const void*, size_t, int, const sockaddr*, socklen_t) EAMPC_ALLOWED;
// A deleted interface that is back: four calls, ten times a second, while nothing can be sent.
unsigned if_nametoindex(const char*) noexcept EAMPC_ALLOWED;
int setsockopt(int, int, int, const void*, socklen_t) noexcept EAMPC_ALLOWED;
int ioctl(int, unsigned long, ...) noexcept EAMPC_ALLOWED;
int bind(int, const sockaddr*, socklen_t) noexcept EAMPC_ALLOWED;
// Arithmetic that the C library keeps to itself.
int* __errno_location() noexcept EAMPC_ALLOWED;
cmsghdr* __cmsg_nxthdr(msghdr*, cmsghdr*) noexcept EAMPC_ALLOWED;
}
#undef EAMPC_ALLOWED
