#include "service/record_pump.hpp"

#include <spdlog/spdlog.h>

namespace eampc::service {
namespace {

std::int64_t now_us() {
  using namespace std::chrono;
  return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

}  // namespace

RecordPump::RecordPump(realtime::ControlLoop& loop, OperatorDesk& desk, Telemetry* telemetry,
                       Recorder* recorder, ExternalReference* external, FlightRecorder* flight)
    : loop_(loop),
      desk_(desk),
      telemetry_(telemetry),
      recorder_(recorder),
      external_(external),
      flight_(flight) {
  if (telemetry_ == nullptr || external_ == nullptr) return;
  telemetry_->subscribe_reference([this](const control::Reference& sample, std::int64_t utime) {
    if (const auto reference = external_->accept(sample, utime, now_us())) desk_.follow(*reference);
  });
}

void RecordPump::start() {
  thread_ = std::thread([this] { run(); });
}

void RecordPump::stop() {
  if (!thread_.joinable()) return;
  stop_.store(true, std::memory_order_release);
  thread_.join();
}

void RecordPump::run() {
  auto health_due = std::chrono::steady_clock::now();
  while (!stop_.load(std::memory_order_acquire)) {
    drain();
    if (flight_ != nullptr) log_flight(flight_->serve());
    if (external_ != nullptr) {
      if (const auto held = external_->expire(now_us())) desk_.follow(*held);
    }
    if (const auto now = std::chrono::steady_clock::now(); now >= health_due) {
      health_due = now + kHealthPeriod;
      log_counters();
      if (telemetry_ != nullptr) telemetry_->publish_health(desk_.status());
    }
    if (telemetry_ != nullptr) {
      telemetry_->receive(kTurnMs);
    } else {
      std::this_thread::sleep_for(std::chrono::milliseconds(kTurnMs));
    }
  }
  drain();
  if (flight_ != nullptr) log_flight(flight_->finish());
  log_counters();
  if (telemetry_ != nullptr) telemetry_->publish_health(desk_.status());
  if (recorder_ != nullptr && !recorder_->close()) spdlog::error("the record file is incomplete");
}

void RecordPump::drain() {
  realtime::LoopRecord record;
  while (loop_.records().pop(record)) {
    if (recorder_ != nullptr) recorder_->write(record);
    if (flight_ != nullptr) flight_->push(record);
    if (telemetry_ != nullptr) telemetry_->publish_state(record);
    log_changes(record);
  }
}

void RecordPump::log_flight(const FlightFile& file) {
  if (!file.path.empty()) spdlog::info("flight record {}", file.path);
  if (!file.error.empty()) spdlog::error("{}", file.error);
}

void RecordPump::log_changes(const realtime::LoopRecord& record) {
  const control::CycleRecord& cycle = record.cycle;
  if (cycle.fault != logged_fault_ && cycle.fault != control::Fault::kNone) {
    spdlog::error("fault at cycle {}: {}", cycle.cycle, control::fault_text(cycle.fault));
  }
  if (cycle.mode != logged_mode_) {
    spdlog::info("{} -> {} at cycle {}", control::mode_text(logged_mode_),
                 control::mode_text(cycle.mode), cycle.cycle);
  }
  logged_fault_ = cycle.fault;
  logged_mode_ = cycle.mode;
}

void RecordPump::log_counters() {
  const realtime::LoopCounters counters = loop_.counters();
  const auto report = [](const char* text, std::int64_t now, std::int64_t& before) {
    if (now > before) spdlog::warn("{}: {} more, {} in all", text, now - before, now);
    before = now;
  };
  report("the interface went down", counters.link_downs, logged_.link_downs);
  report("error frames on the bus", counters.error_frames, logged_.error_frames);
  report("command frames the bus refused", counters.send_errors, logged_.send_errors);
  report("records that telemetry missed", counters.telemetry_dropped, logged_.telemetry_dropped);
}

}  // namespace eampc::service
