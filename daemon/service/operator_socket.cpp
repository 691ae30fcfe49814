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
#include <utility>

#include "service/options.hpp"

namespace eampc::service {
namespace {

bool somebody_listens(const sockaddr_un& address) {
  const realtime::FileDescriptor probe(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  return ::connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

}  // namespace

OperatorSocket::OperatorSocket(std::string path, OperatorDesk& desk)
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
  const mode_t before = ::umask(0177);  // 0600 from the first moment on
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
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(stop_event_.get(), &one, sizeof one);
  thread_.join();
}

void OperatorSocket::serve() {
  for (;;) {
    std::vector<pollfd> watched{{stop_event_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
    for (const Client& client : clients_) {
      const auto events = static_cast<short>(client.to_send.empty() ? POLLIN : POLLIN | POLLOUT);
      watched.push_back({client.fd.get(), events, 0});
    }
    if (::poll(watched.data(), watched.size(), -1) < 0) continue;
    if (watched[0].revents != 0) return;
    std::size_t i = 2;
    for (auto client = clients_.begin(); client != clients_.end(); ++i) {
      const short events = watched[i].revents;
      bool alive = true;
      if ((events & (POLLIN | POLLHUP | POLLERR)) != 0) alive = read_from(*client);
      if (alive && !client->to_send.empty()) alive = write_to(*client);
      client = alive ? std::next(client) : clients_.erase(client);
    }
    if (watched[1].revents != 0) accept_client();
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
  return answer_requests(client);
}

bool OperatorSocket::answer_requests(Client& client) {
  for (;;) {
    std::uint32_t length = 0;
    if (client.received.size() < sizeof length) return true;
    std::memcpy(&length, client.received.data(), sizeof length);
    OperatorReply reply;
    const bool too_long = length > kMaxRequestBytes;
    if (too_long) {
      reply =
          desk_.refuse("the request is longer than " + std::to_string(kMaxRequestBytes) + " bytes");
    } else {
      if (client.received.size() < sizeof length + length) return true;
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
    if (!write_to(client) || too_long || client.to_send.size() > kMaxUnsentBytes) return false;
  }
}

bool OperatorSocket::write_to(Client& client) {
  const ssize_t size =
      ::send(client.fd.get(), client.to_send.data(), client.to_send.size(), MSG_NOSIGNAL);
  if (size < 0) return errno == EAGAIN || errno == EINTR;
  client.to_send.erase(client.to_send.begin(), client.to_send.begin() + size);
  return true;
}

}  // namespace eampc::service
