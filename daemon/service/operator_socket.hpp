// The Unix socket operators talk to. One thread, poll(), several clients; a slow or silent client
// delays nobody. File permissions (0600) say who may operate.
#pragma once

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
  OperatorSocket(std::string path, OperatorDesk& desk);
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

  static constexpr std::size_t kMaxClients = 16;
  // A client that does not read its replies is dropped beyond this.
  static constexpr std::size_t kMaxUnsentBytes = 64 * 1024;

  void serve();
  void accept_client();
  bool read_from(Client& client);  // false: the client is gone or misbehaved
  bool answer_requests(Client& client);
  static bool write_to(Client& client);

  const std::string path_;
  OperatorDesk& desk_;
  realtime::FileDescriptor listener_;
  realtime::FileDescriptor stop_event_;
  std::list<Client> clients_;
  std::thread thread_;
};

}  // namespace eampc::service
