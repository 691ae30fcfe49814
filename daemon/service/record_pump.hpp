// The ordinary thread behind the control loop: takes its records out of the queue and hands them to
// the recorder and to LCM, publishes health, logs changes of mode, fault and link, and passes
// references by LCM on.
#pragma once

#include <atomic>
#include <chrono>
#include <optional>
#include <thread>

#include "realtime/control_loop.hpp"
#include "service/external_reference.hpp"
#include "service/flight_recorder.hpp"
#include "service/operator_desk.hpp"
#include "service/recorder.hpp"
#include "service/telemetry.hpp"

namespace eampc::service {

class RecordPump {
 public:
  // `telemetry`, `recorder`, `external` and `flight` may be null.
  RecordPump(realtime::ControlLoop& loop, OperatorDesk& desk, Telemetry* telemetry,
             Recorder* recorder, ExternalReference* external, FlightRecorder* flight);
  ~RecordPump() { stop(); }
  RecordPump(const RecordPump&) = delete;
  RecordPump& operator=(const RecordPump&) = delete;

  void start();
  void stop();  // after the loop has ended: everything still queued is written first

 private:
  // At 1 kHz five records per turn; the queue holds 4096.
  static constexpr int kTurnMs = 5;
  static constexpr std::chrono::seconds kHealthPeriod{1};

  void run();
  void drain();
  void log_changes(const realtime::LoopRecord& record);
  void log_counters();
  static void log_flight(const FlightFile& file);

  realtime::ControlLoop& loop_;
  OperatorDesk& desk_;
  Telemetry* telemetry_;
  Recorder* recorder_;
  ExternalReference* external_;
  FlightRecorder* flight_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
  control::Mode logged_mode_ = control::Mode::kInit;
  control::Fault logged_fault_ = control::Fault::kNone;
  realtime::LoopCounters logged_;
};

}  // namespace eampc::service
