#include "service/operator_desk.hpp"

#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "service/record_texts.hpp"

namespace eampc::service {
namespace {

control::OperatorAction action_of(Command command) {
  switch (command) {
    case Command::kArm:
      return control::OperatorAction::kArm;
    case Command::kDisarm:
      return control::OperatorAction::kDisarm;
    case Command::kReset:
      return control::OperatorAction::kReset;
    default:
      return control::OperatorAction::kNone;
  }
}

// Why a bus is not fit for arming, and what to do about it; empty: it is.
std::string bus_refusal(const control::BusHealth& health, const std::string& bus_url) {
  const std::string name = bus_url.substr(bus_url.find(':') + 1);
  const std::string restart = "`ip link set " + name + " down` and `ip link set " + name + " up`";
  if (health.link_down) {
    return name + " is down or gone; bring it up with `ip link set " + name + " up`";
  }
  if (health.bus_off) {
    return name + " is bus-off; check the cable, then restart it with " + restart;
  }
  if (!health.queue_proved_empty) {
    return "an old command may still wait in the queue of " + name +
           ", because no frame of ours was confirmed on the bus since it came up; switch the valve "
           "node on, or empty the queue with " +
           restart + " (eampcd --restart-interface does it by itself)";
  }
  return {};
}

const char* name_of(Command command) {
  switch (command) {
    case Command::kArm:
      return "arm";
    case Command::kDisarm:
      return "disarm";
    case Command::kReset:
      return "reset";
    case Command::kReference:
      return "reference";
    case Command::kStatus:
      return "status";
    case Command::kFlight:
      return "flight";
  }
  return "command";
}

}  // namespace

OperatorDesk::OperatorDesk(realtime::ControlLoop& loop, DeskSettings settings)
    : loop_(loop), settings_(std::move(settings)) {}

void OperatorDesk::set_realtime_text(std::string text) {
  const std::lock_guard lock(mutex_);
  realtime_text_ = std::move(text);
}

OperatorReply OperatorDesk::status(bool ok, std::string message) const {
  OperatorReply reply;
  reply.ok = ok;
  reply.message = std::move(message);
  reply.newest = loop_.newest();
  reply.refusal = reply.newest.cycle.refusal;
  reply.refusal_cause = reply.newest.cycle.refusal_cause;
  reply.counters = loop_.counters();
  reply.arrival_to_sent_p50_us = loop_.arrival_to_sent().quantile_us(0.50);
  reply.arrival_to_sent_p99_us = loop_.arrival_to_sent().quantile_us(0.99);
  reply.arrival_to_sent_max_us = loop_.arrival_to_sent().max_us();
  reply.law_sha256 = settings_.law_sha256;
  reply.rig_name = settings_.rig_name;
  reply.bus = settings_.bus_url;
  const std::lock_guard lock(mutex_);
  reply.realtime_text = realtime_text_;
  return reply;
}

OperatorReply OperatorDesk::refuse(std::string reason) const {
  return status(false, std::move(reason));
}

OperatorDesk::Objection OperatorDesk::objection(const OperatorRequest& request) const {
  using control::Refusal;
  const realtime::LoopRecord newest = loop_.newest();
  const bool now = request.at_cycle < 0;
  if (!now && request.at_cycle <= newest.cycle.cycle) {
    return {"cycle " + std::to_string(request.at_cycle) + " is over, the daemon is at cycle " +
            std::to_string(newest.cycle.cycle) + "; leave at_cycle out to act now"};
  }
  if (request.command != Command::kArm) return {};
  if (!settings_.arming_allowed) return {settings_.arming_refusal};
  if (!now) return {};  // judged by the control cycle when its time comes
  if (newest.cycle.fault != control::Fault::kNone) {
    return {std::string("the fault \"") + control::fault_text(newest.cycle.fault) +
                "\" is latched; run `eampc reset` first",
            Refusal::kFaultLatched, newest.cycle.fault};
  }
  if (newest.cycle.mode == control::Mode::kArming || newest.cycle.mode == control::Mode::kActive) {
    return {
        std::string("the joint is armed already (") + control::mode_text(newest.cycle.mode) + ")",
        Refusal::kAlreadyArmed};
  }
  if (newest.cycle.mode == control::Mode::kSoftStop) {
    return {"the joint is still coming to rest (SOFT_STOP); arm again when it is DISARMED",
            Refusal::kNotAtRest};
  }
  if (loop_.counters().valid_frames == 0) {
    return {"no valid encoder frame was seen on " + settings_.bus_url + "; is the encoder on?",
            Refusal::kNoEncoderFrame};
  }
  if (std::string reason = bus_refusal(loop_.bus_report().health, settings_.bus_url);
      !reason.empty()) {
    return {std::move(reason), Refusal::kQueueNotProvedEmpty};
  }
  return {};
}

OperatorReply OperatorDesk::write_flight_record() const {
  if (flight_ == nullptr) {
    return status(false, "eampcd keeps no flight records; start it with --flight-folder FOLDER");
  }
  const FlightFile file = flight_->write_now(kFlightLimit);
  return status(!file.path.empty(), file.path.empty() ? file.error : file.path);
}

std::uint64_t OperatorDesk::hand_over(realtime::LoopCommand command) {
  command.id = next_id_;
  if (!loop_.commands().push(command)) return 0;
  if (command.at_cycle >= 0) ++scheduled_;
  return next_id_++;
}

bool OperatorDesk::may_schedule() const {
  constexpr auto kMost = static_cast<std::int64_t>(realtime::ControlLoop::kMaxScheduled);
  return scheduled_ - loop_.scheduled_done() < kMost;
}

bool OperatorDesk::wait_until_executed(std::uint64_t id) const {
  const auto limit = std::chrono::steady_clock::now() + kExecutionLimit;
  while (loop_.newest().executed_command < id) {
    if (std::chrono::steady_clock::now() >= limit) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

OperatorReply OperatorDesk::answer(OperatorRequest request) {
  if (request.command == Command::kStatus) return status(true, "");
  if (request.command == Command::kFlight) return write_flight_record();
  if (Objection no = objection(request); !no.reason.empty()) {
    OperatorReply reply = status(false, std::move(no.reason));
    if (request.command == Command::kArm) {
      reply.refusal = no.refusal;
      reply.refusal_cause = no.cause;
    }
    return reply;
  }

  realtime::LoopCommand command;
  command.at_cycle = request.at_cycle;
  command.action = action_of(request.command);
  command.has_reference = request.command == Command::kReference;
  command.reference = request.reference;
  std::uint64_t id = 0;
  {
    std::unique_lock lock(mutex_);
    if (request.at_cycle >= 0 && !may_schedule()) {
      lock.unlock();  // status() takes it again
      return status(false, std::to_string(realtime::ControlLoop::kMaxScheduled) +
                               " commands wait for their cycle already; leave at_cycle out, or let "
                               "theirs come first");
    }
    if (!request.table.empty()) {
      tables_.collect(loop_.released_tables());
      command.reference.samples = static_cast<std::int32_t>(request.table.size());
      command.reference.table = tables_.keep(std::move(request.table));
    }
    const bool has_room = command.reference.kind != control::ReferenceKind::kTable ||
                          command.reference.table != nullptr;
    if (has_room) id = hand_over(command);
    if (id == 0 && command.reference.table != nullptr) tables_.drop(command.reference.table);
    if (!has_room) id = UINT64_MAX;
  }
  const std::string name = name_of(request.command);
  if (id == UINT64_MAX) {
    return status(false,
                  "there is no room for this table beside the ones still waiting; send fewer rows");
  }
  if (id == 0)
    return status(false, "too many commands are waiting for the control loop; try again");
  if (request.at_cycle >= 0) {
    return status(true, name + " will be executed at cycle " + std::to_string(request.at_cycle));
  }
  if (!wait_until_executed(id)) {
    return status(true, name + " waits for the next cycle; no encoder frame came meanwhile");
  }
  OperatorReply reply = status(true, "");
  const control::Mode mode = reply.newest.cycle.mode;
  switch (request.command) {
    case Command::kArm:
      reply.ok = mode == control::Mode::kArming || mode == control::Mode::kActive;
      break;
    case Command::kDisarm:
      reply.ok = mode != control::Mode::kArming && mode != control::Mode::kActive;
      break;
    case Command::kReset:
      reply.ok = reply.newest.cycle.fault == control::Fault::kNone;
      break;
    default:
      break;
  }
  reply.message = name + (reply.ok ? " done, the mode is " : " was not obeyed, the mode is ") +
                  control::mode_text(mode);
  const bool edge = request.command == Command::kArm || request.command == Command::kReset;
  if (edge && !reply.ok && reply.refusal != control::Refusal::kNone) {
    reply.message += ": " + refusal_sentence(reply.refusal, reply.refusal_cause);
  } else if (reply.newest.cycle.fault != control::Fault::kNone) {
    reply.message += std::string(", fault: ") + control::fault_text(reply.newest.cycle.fault);
  }
  return reply;
}

std::uint64_t OperatorDesk::disarm() {
  realtime::LoopCommand command;
  command.action = control::OperatorAction::kDisarm;
  const std::lock_guard lock(mutex_);
  return hand_over(command);
}

bool OperatorDesk::follow(const control::Reference& external) {
  realtime::LoopCommand command;
  command.has_reference = true;
  command.reference.kind = control::ReferenceKind::kExternal;
  command.reference.external = external;
  const std::lock_guard lock(mutex_);
  tables_.collect(loop_.released_tables());
  return hand_over(command) != 0;
}

}  // namespace eampc::service
