// The Unix socket operators talk to. One thread, poll(), several clients that take turns by single
// requests: a slow, silent or flooding one delays the others by one request at most. File
// permissions say who may operate.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstdint>
#include <list>
#include <string>
#include <thread>
#include <vector>

#include "realtime/file_descriptor.hpp"
#include "service/operator_desk.hpp"

namespace eampc::service {

class OperatorSocket {
 public:
  // Binds and listens. Throws BadInput. A socket file nobody listens on is replaced.
  // `mode` of the file: 0600, or 0660 for everybody in its group.
  OperatorSocket(std::string path, OperatorDesk& desk, mode_t mode = 0600);
  ~OperatorSocket();  // stops the thread and removes the file
  OperatorSocket(const OperatorSocket&) = delete;
  OperatorSocket& operator=(const OperatorSocket&) = delete;

  void start();
  void stop();

 private:
  struct Client {
    realtime::FileDescriptor fd;
    std::vector<std::uint8_t> received;
    std::vector<std::uint8_t> to_send;
  };

  // An operator, a monitor and a few scripts; each may hold a whole request of locked memory.
  static constexpr std::size_t kMaxClients = 16;
  // A client that does not read its replies is dropped beyond this: about 90 replies of 0.7 kB.
  static constexpr std::size_t kMaxUnsentBytes = 64 * 1024;

  void serve();
  void accept_client();
  bool read_from(Client& client);                 // false: the client is gone or misbehaved
  static bool has_request(const Client& client);  // a whole one, or one that is too long
  bool answer_request(Client& client);
  bool serve_client(Client& client, short events);
  static bool write_to(Client& client);

  const std::string path_;
  OperatorDesk& desk_;
  realtime::FileDescriptor listener_;
  realtime::FileDescriptor stop_event_;
  std::list<Client> clients_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace eampc::service
