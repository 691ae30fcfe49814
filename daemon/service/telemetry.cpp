#include "service/telemetry.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <sstream>
#include <thread>
#include <utility>

#include "realtime/file_descriptor.hpp"
#include "service/options.hpp"
#include "service/record_texts.hpp"

namespace eampc::service {
namespace {

// LCM explains itself on standard error, over several lines. Ours is one sentence: collect what it
// says meanwhile.
class CapturedStandardError {
 public:
  CapturedStandardError()
      : saved_(::fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 3)),
        file_(::memfd_create("lcm", MFD_CLOEXEC)) {
    std::fflush(stderr);
    ::dup2(file_.get(), STDERR_FILENO);
  }
  ~CapturedStandardError() { restore(); }

  // The line that names the cause.
  std::string cause() {
    restore();
    std::array<char, 4096> text;
    const ssize_t size = ::pread(file_.get(), text.data(), text.size(), 0);
    std::istringstream lines(
        std::string(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0));
    std::string first, line;
    while (std::getline(lines, line)) {
      if (line.rfind("Error: ", 0) == 0) return line.substr(7);
      if (first.empty() && line.rfind("LCM tcpq: connecting", 0) != 0) first = line;
    }
    return first.empty() ? "no reason given" : first;
  }

 private:
  void restore() {
    if (saved_.get() < 0) return;
    std::fflush(stderr);
    ::dup2(saved_.get(), STDERR_FILENO);
    saved_.reset();
  }
  realtime::FileDescriptor saved_, file_;
};

lcm_t* open_lcm(const std::string& url) {
  CapturedStandardError captured;
  lcm_t* lcm = ::lcm_create(url.c_str());
  if (lcm == nullptr) {
    throw BadInput("cannot reach LCM at " + url + ": " + captured.cause() +
                   "; check the URL, add a multicast route with `ip route add 239.255.76.67/32 dev "
                   "lo`, or use "
                   "--lcm-url none");
  }
  return lcm;
}

std::int64_t now_us() {
  using namespace std::chrono;
  return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

}  // namespace

Telemetry::Telemetry(const std::string& lcm_url, std::int32_t state_decimation)
    : handle_(open_lcm(lcm_url)), lcm_(handle_.get()), state_decimation_(state_decimation) {}

void Telemetry::subscribe_reference(ReferenceHandler handler) {
  // A function object, not LCM's pointer to a member: GCC 12's sanitizer takes that one for null.
  const lcm::LCM::HandlerFunction<eampc_lcm::reference_t> on_message =
      [handler = std::move(handler)](const lcm::ReceiveBuffer*, const std::string&,
                                     const eampc_lcm::reference_t* message) {
        handler({message->angle_rad, message->velocity_rad_s, message->acceleration_rad_s2},
                message->utime);
      };
  lcm_.subscribe("EAMPC_REFERENCE", on_message)->setQueueCapacity(8);
  subscribed_ = true;
}

void Telemetry::receive(int wait_ms) {
  if (!subscribed_) {
    std::this_thread::sleep_for(std::chrono::milliseconds(wait_ms));
    return;
  }
  int wait = wait_ms;
  for (int i = 0; i < kMaxReferencesPerTurn && lcm_.handleTimeout(wait) > 0; ++i) wait = 0;
}

void Telemetry::publish_state(const realtime::LoopRecord& record) {
  const control::CycleRecord& cycle = record.cycle;
  if (cycle.cycle % state_decimation_ != 0) return;
  state_.utime = record.arrival_ns / 1000;
  state_.cycle = cycle.cycle;
  state_.scenario_time_s = cycle.scenario_time_s;
  state_.reference_angle_rad = cycle.reference.angle_rad;
  state_.reference_velocity_rad_s = cycle.reference.velocity_rad_s;
  state_.measured_angle_rad = cycle.sample.angle_rad;
  state_.angle_rad = cycle.state.x[0];
  state_.velocity_rad_s = cycle.state.x[1];
  state_.valve_control = cycle.state.x[2];
  state_.pressure1_kPa = cycle.pressure1_kPa;
  state_.pressure2_kPa = cycle.pressure2_kPa;
  state_.supply_pressure_kPa = cycle.supply_pressure_kPa;
  state_.disturbance_rad_s2 = cycle.disturbance.for_law[1];
  state_.control = cycle.law.u;
  state_.u1_V = cycle.valves.u1_V;
  state_.u2_V = cycle.valves.u2_V;
  state_.region = cycle.law.region;
  state_.mode = static_cast<std::int8_t>(cycle.mode);
  state_.mode_text = control::mode_text(cycle.mode);
  state_.fault = static_cast<std::int16_t>(cycle.fault);
  state_.fault_text = control::fault_text(cycle.fault);
  state_.present_faults = static_cast<std::int32_t>(cycle.present_faults.bits());
  state_.limits = static_cast<std::int32_t>(cycle.limits);
  state_.limits_text = limits_text(cycle.limits);
  state_.arrival_to_wake_us = record.arrival_to_wake_us;
  state_.wake_to_decided_us = record.wake_to_decided_us;
  state_.decided_to_sent_us = record.decided_to_sent_us;
  state_.arrival_to_sent_us = record.arrival_to_sent_us;
  lcm_.publish("EAMPC_STATE", &state_);
}

void Telemetry::publish_health(const OperatorReply& status) {
  const control::CycleRecord& cycle = status.newest.cycle;
  const realtime::LoopCounters& counters = status.counters;
  eampc_lcm::health_t health{};
  health.utime = now_us();
  health.version = EAMPC_VERSION;
  health.rig_name = status.rig_name;
  health.law_sha256 = status.law_sha256;
  health.bus = status.bus;
  health.mode = static_cast<std::int8_t>(cycle.mode);
  health.mode_text = control::mode_text(cycle.mode);
  health.fault = static_cast<std::int16_t>(cycle.fault);
  health.fault_text = control::fault_text(cycle.fault);
  health.present_faults = static_cast<std::int32_t>(cycle.present_faults.bits());
  health.present_faults_text = causes_text(cycle.present_faults);
  health.refusal = static_cast<std::int8_t>(status.refusal);
  health.refusal_cause = static_cast<std::int16_t>(status.refusal_cause);
  health.refusal_text = refusal_sentence(status.refusal, status.refusal_cause);
  health.cycles = counters.cycles;
  health.encoder_frames = counters.encoder_frames;
  health.missed_cycles = counters.missed_cycles();
  health.duplicate_frames = counters.duplicate_frames;
  health.invalid_frames = counters.invalid_frames;
  health.deadline_overruns = counters.deadline_overruns;
  health.send_errors = counters.send_errors;
  health.telemetry_dropped = counters.telemetry_dropped;
  health.arrival_to_sent_p50_us = status.arrival_to_sent_p50_us;
  health.arrival_to_sent_p99_us = status.arrival_to_sent_p99_us;
  health.arrival_to_sent_max_us = status.arrival_to_sent_max_us;
  health.realtime_text = status.realtime_text;
  lcm_.publish("EAMPC_HEALTH", &health);
}

}  // namespace eampc::service
