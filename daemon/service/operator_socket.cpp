#include "service/operator_socket.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <new>
#include <utility>

#include "service/options.hpp"

namespace eampc::service {
namespace {

bool somebody_listens(const sockaddr_un& address) {
  const realtime::FileDescriptor probe(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  return ::connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

}  // namespace

OperatorSocket::OperatorSocket(std::string path, OperatorDesk& desk, mode_t mode)
    : path_(std::move(path)), desk_(desk) {
  const std::string prefix = "cannot listen on the operator socket " + path_ + ": ";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path_.size() >= sizeof address.sun_path) {
    throw BadInput(prefix + "the path is longer than " +
                   std::to_string(sizeof address.sun_path - 1) +
                   " bytes; choose a shorter one with --socket");
  }
  std::memcpy(address.sun_path, path_.c_str(), path_.size());

  struct stat present {};
  if (::lstat(path_.c_str(), &present) == 0) {
    if (!S_ISSOCK(present.st_mode)) {
      throw BadInput(prefix +
                     "the file exists and is not a socket; choose another path with --socket");
    }
    if (somebody_listens(address)) {
      throw BadInput(prefix +
                     "another eampcd listens there; stop it or choose another path with --socket");
    }
    ::unlink(path_.c_str());
  }

  listener_ =
      realtime::FileDescriptor(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const mode_t before = ::umask(0777 & ~mode);  // right from the first moment on
  const int bound =
      ::bind(listener_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address);
  const int bind_error = errno;
  ::umask(before);
  if (bound != 0) {
    throw BadInput(prefix + std::strerror(bind_error) + "; choose another path with --socket");
  }
  if (::listen(listener_.get(), static_cast<int>(kMaxClients)) != 0) {
    throw BadInput(prefix + std::strerror(errno));
  }
  stop_event_ = realtime::FileDescriptor(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
}

OperatorSocket::~OperatorSocket() {
  stop();
  if (listener_.get() >= 0) ::unlink(path_.c_str());
}

void OperatorSocket::start() {
  thread_ = std::thread([this] { serve(); });
}

void OperatorSocket::stop() {
  if (!thread_.joinable()) return;
  stopping_.store(true, std::memory_order_relaxed);
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(stop_event_.get(), &one, sizeof one);
  thread_.join();
}

void OperatorSocket::serve() {
  for (;;) {
    std::vector<pollfd> watched{{stop_event_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
    bool request_waits = false;
    for (const Client& client : clients_) {
      // Nothing more is read from a client whose last request is not answered yet.
      const bool has = has_request(client);
      request_waits |= has;
      const int events = (has ? 0 : POLLIN) | (client.to_send.empty() ? 0 : POLLOUT);
      watched.push_back({client.fd.get(), static_cast<short>(events), 0});
    }
    if (::poll(watched.data(), watched.size(), request_waits ? 0 : -1) < 0) continue;
    std::size_t i = 2;
    for (auto client = clients_.begin(); client != clients_.end(); ++i) {
      if (stopping_.load(std::memory_order_relaxed)) return;
      client =
          serve_client(*client, watched[i].revents) ? std::next(client) : clients_.erase(client);
    }
    if (stopping_.load(std::memory_order_relaxed)) return;
    if (watched[1].revents != 0) accept_client();
  }
}

bool OperatorSocket::serve_client(Client& client, short events) {
  try {
    const bool readable = (events & (POLLIN | POLLHUP | POLLERR)) != 0;
    if (readable && !has_request(client) && !read_from(client)) return false;
    if (has_request(client) && !answer_request(client)) return false;
    return client.to_send.empty() || write_to(client);
  } catch (const std::bad_alloc&) {
    return false;  // locked memory is scarce; a table too many must not end the control loop
  }
}

void OperatorSocket::accept_client() {
  realtime::FileDescriptor fd(
      ::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (fd.get() < 0) return;
  if (clients_.size() >= kMaxClients)
    clients_.pop_front();  // the oldest is the likeliest to be forgotten
  clients_.push_back({std::move(fd), {}, {}});
}

bool OperatorSocket::read_from(Client& client) {
  std::array<std::uint8_t, 16 * 1024> chunk;
  const ssize_t size = ::recv(client.fd.get(), chunk.data(), chunk.size(), 0);
  if (size == 0) return false;
  if (size < 0) return errno == EAGAIN || errno == EINTR;
  client.received.insert(client.received.end(), chunk.begin(), chunk.begin() + size);
  return true;
}

bool OperatorSocket::has_request(const Client& client) {
  std::uint32_t length = 0;
  if (client.received.size() < sizeof length) return false;
  std::memcpy(&length, client.received.data(), sizeof length);
  return length > kMaxRequestBytes || client.received.size() - sizeof length >= length;
}

bool OperatorSocket::answer_request(Client& client) {
  std::uint32_t length = 0;
  std::memcpy(&length, client.received.data(), sizeof length);
  OperatorReply reply;
  const bool too_long = length > kMaxRequestBytes;
  if (too_long) {
    reply =
        desk_.refuse("the request is longer than " + std::to_string(kMaxRequestBytes) + " bytes");
  } else {
    try {
      reply = desk_.answer(parse_request(
          std::span<const std::uint8_t>(client.received).subspan(sizeof length, length)));
    } catch (const BadInput& error) {
      reply = desk_.refuse(error.what());
    }
    client.received.erase(
        client.received.begin(),
        client.received.begin() + static_cast<std::ptrdiff_t>(sizeof length + length));
    if (client.received.empty()) client.received.shrink_to_fit();
  }
  const std::vector<std::uint8_t> message = pack_reply(reply);
  client.to_send.insert(client.to_send.end(), message.begin(), message.end());
  return write_to(client) && !too_long && client.to_send.size() <= kMaxUnsentBytes;
}

bool OperatorSocket::write_to(Client& client) {
  const ssize_t size =
      ::send(client.fd.get(), client.to_send.data(), client.to_send.size(), MSG_NOSIGNAL);
  if (size < 0) return errno == EAGAIN || errno == EINTR;
  client.to_send.erase(client.to_send.begin(), client.to_send.begin() + size);
  return true;
}

}  // namespace eampc::service
