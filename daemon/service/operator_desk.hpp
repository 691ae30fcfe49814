// Decides on operator requests and hands the accepted ones to the control loop. Any service thread
// may call it; the loop is never waited for longer than kExecutionLimit, and never made to wait.
#pragma once

#include <chrono>
#include <mutex>
#include <string>

#include "realtime/control_loop.hpp"
#include "service/flight_recorder.hpp"
#include "service/operator_request.hpp"
#include "service/reference_tables.hpp"

namespace eampc::service {

struct DeskSettings {
  std::string law_sha256;
  std::string rig_name;
  std::string bus_url;
  bool arming_allowed = true;
  std::string arming_refusal;  // why not
};

class OperatorDesk {
 public:
  OperatorDesk(realtime::ControlLoop& loop, DeskSettings settings);

  OperatorReply answer(OperatorRequest request);
  // A reply for a message that could not be understood.
  OperatorReply refuse(std::string reason) const;

  OperatorReply status(bool ok = true, std::string message = "") const;

  // For SIGTERM: the command's id, 0 if the queue is full.
  std::uint64_t disarm();
  // For references by LCM. False: the queue is full.
  bool follow(const control::Reference& external);

  void set_realtime_text(std::string text);
  // Before the first request; must outlive the desk.
  void set_flight_recorder(FlightRecorder* flight) { flight_ = flight; }

 private:
  // Generous against a busy machine, short against a person's patience.
  static constexpr std::chrono::milliseconds kExecutionLimit{250};

  // Long enough for a slow disk, short against a client's patience.
  static constexpr std::chrono::milliseconds kFlightLimit{2000};

  struct Objection {
    std::string reason;  // empty: none
    control::Refusal refusal = control::Refusal::kNone;
    control::Fault cause = control::Fault::kNone;
  };

  Objection objection(const OperatorRequest& request) const;
  OperatorReply write_flight_record() const;
  std::uint64_t hand_over(realtime::LoopCommand command);  // its id, or 0 if the queue is full
  bool may_schedule() const;
  bool wait_until_executed(std::uint64_t id) const;

  realtime::ControlLoop& loop_;
  const DeskSettings settings_;
  FlightRecorder* flight_ = nullptr;
  mutable std::mutex mutex_;  // one producer at a time on the command queue; tables_, next_id_,
                              // scheduled_, realtime_text_
  ReferenceTables tables_;
  std::uint64_t next_id_ = 1;
  std::int64_t scheduled_ = 0;  // commands for a later cycle, handed over so far
  std::string realtime_text_;
};

}  // namespace eampc::service
