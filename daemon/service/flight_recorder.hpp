// The last cycles before a fault and the first behind it, on disk: a ring of whole records, memory
// of its own from the start on, written as one file when a fault was latched and whenever somebody
// asks. push(), serve() and finish() belong to one ordinary thread (the record pump).
//
// A file is a MessagePack map that explains itself: format, version, rig, law, bus, period, reason,
// and `columns` (name, unit) for `data`, {"shape": [rows, columns], "f64": bytes}, little-endian,
// row-major; `texts` says what the numbers of mode, fault, verdict, refusal and the bits of limits
// mean. The folder keeps the newest kMostFiles; nothing else in it is touched.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "realtime/control_loop.hpp"

namespace eampc::service {

struct FlightSettings {
  std::string folder;
  std::string rig_name;
  std::string law_sha256;
  std::string bus_url;
  double period_s = 0.0;
};

struct FlightFile {
  std::string path;   // empty: not written
  std::string error;  // one sentence
};

class FlightRecorder {
 public:
  static constexpr std::size_t kCycles = 4096;  // 20 s at 200 Hz, 4 s at 1 kHz
  static constexpr std::size_t kCyclesAfterFault = 512;
  static constexpr std::size_t kMostFiles = 32;

  // Makes the folder if it is not there. Throws BadInput.
  explicit FlightRecorder(FlightSettings settings);

  void push(const realtime::LoopRecord& record);
  // Writes what is due; of several files the last one is returned, of none an empty one.
  FlightFile serve();
  FlightFile finish();  // the same, without waiting for what comes behind a fault

  // From any thread: asks for a file and waits until it is there.
  FlightFile write_now(std::chrono::milliseconds limit);

 private:
  FlightFile write(const std::string& reason, control::Fault fault);
  void forget_oldest() const;

  const FlightSettings settings_;
  std::vector<realtime::LoopRecord> ring_;
  std::size_t next_ = 0;
  std::size_t count_ = 0;

  control::Fault last_fault_ = control::Fault::kNone;
  control::Fault due_for_ = control::Fault::kNone;  // a fault whose file is still to be written
  std::size_t due_in_ = 0;                          // cycles
  std::chrono::steady_clock::time_point due_at_;

  std::mutex mutex_;
  std::condition_variable answered_;
  std::uint64_t asked_ = 0;
  std::uint64_t done_ = 0;
  FlightFile answer_;
};

// $STATE_DIRECTORY (systemd), else $XDG_STATE_HOME/eampc, else ~/.local/state/eampc; empty without
// a home.
std::string default_flight_folder();

}  // namespace eampc::service
