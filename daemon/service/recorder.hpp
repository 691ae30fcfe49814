// Writes every cycle's record as one CSV line (--record). Buffered; called by the record pump's
// thread only.
#pragma once

#include <cstdio>
#include <memory>
#include <string>

#include "realtime/control_loop.hpp"

namespace eampc::service {

class Recorder {
 public:
  explicit Recorder(const std::string& path);  // writes the header line; throws BadInput

  void write(const realtime::LoopRecord& record);
  // False if the file is incomplete (a full disk).
  bool close();

 private:
  struct Closer {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };
  std::unique_ptr<std::FILE, Closer> file_;
  std::string line_;
  bool complete_ = true;
};

}  // namespace eampc::service
