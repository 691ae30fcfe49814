#include "service/daemon.hpp"

#include <pthread.h>
#include <signal.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "realtime/bus.hpp"
#include "realtime/can_link.hpp"
#include "realtime/control_loop.hpp"
#include "service/bus_keeper.hpp"
#include "service/flight_recorder.hpp"
#include "service/law_file.hpp"
#include "service/operator_desk.hpp"
#include "service/operator_socket.hpp"
#include "service/record_pump.hpp"
#include "service/rig_name.hpp"
#include "service/service_manager.hpp"

namespace eampc::service {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

// The one thread that is allowed a real-time policy. std::thread cannot set a stack size.
class ControlThread {
 public:
  ControlThread(realtime::ControlLoop& loop, const realtime::RealtimeSettings& settings)
      : loop_(loop), settings_(settings) {}
  ~ControlThread() { stop(); }
  ControlThread(const ControlThread&) = delete;
  ControlThread& operator=(const ControlThread&) = delete;

  // Returns once the thread has asked for real time, with what it was given; the loop waits for
  // begin().
  realtime::RealtimeState start() {
    pthread_attr_t attributes;
    ::pthread_attr_init(&attributes);
    ::pthread_attr_setstacksize(&attributes, realtime::kThreadStackBytes);
    const int error = ::pthread_create(&thread_, &attributes, &ControlThread::body, this);
    ::pthread_attr_destroy(&attributes);
    if (error != 0) throw BadInput("cannot start the control thread: not enough memory or threads");
    running_ = true;
    entered_.wait(false);
    return state_;
  }
  void begin() {
    begun_.store(true);
    begun_.notify_one();
  }
  void stop() {
    if (!running_) return;
    loop_.request_stop();
    begin();
    ::pthread_join(thread_, nullptr);
    running_ = false;
  }

 private:
  static void* body(void* self) {
    auto& thread = *static_cast<ControlThread*>(self);
    thread.state_ = realtime::enter_realtime(thread.settings_);
    thread.entered_.store(true);
    thread.entered_.notify_one();
    thread.begun_.wait(false);
    thread.loop_.run();
    return nullptr;
  }

  realtime::ControlLoop& loop_;
  const realtime::RealtimeSettings settings_;
  pthread_t thread_{};
  bool running_ = false;
  std::atomic<bool> entered_{false}, begun_{false};
  realtime::RealtimeState state_;
};

sigset_t stop_signals() {
  sigset_t signals;
  ::sigemptyset(&signals);
  ::sigaddset(&signals, SIGTERM);
  ::sigaddset(&signals, SIGINT);
  // A terminal that closes or sends a quit: to the joint the same thing.
  ::sigaddset(&signals, SIGHUP);
  ::sigaddset(&signals, SIGQUIT);
  return signals;
}

void start_log(const std::string& level) {
  auto logger = spdlog::stderr_logger_mt("eampcd");
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e eampcd %l: %v");
  logger->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(std::move(logger));
}

void check_rig(const Options& options, const LawMeta& law) {
  if (options.rig.empty()) return;
  const std::string name = read_rig_name(options.rig);
  if (name != law.rig_name) {
    throw BadInput("the law file " + options.law_file + " was designed for the rig \"" +
                   law.rig_name + "\", but " + options.rig + " is \"" + name +
                   "\"; run `eampc design " + options.rig + "`");
  }
}

realtime::Bus open_bus(const realtime::BusAddress& address,
                       const control::ControllerConfig& config) {
  realtime::BusFrames frames;
  frames.encoder = {config.encoder.id, config.encoder.extended};
  frames.own.add({config.valve_command.id, config.valve_command.extended});
  if (config.trigger_on_sync && config.sync.present)
    frames.own.add({config.sync.id, config.sync.extended});
  for (const control::MonitoredLayout* layout :
       std::initializer_list<const control::MonitoredLayout*>{&config.valve_feedback,
                                                              &config.heartbeat, &config.emergency,
                                                              &config.e_stop, &config.identity}) {
    if (layout->present) frames.monitored.add({layout->id, layout->extended});
  }
  try {
    return realtime::open_bus(address, frames);
  } catch (const std::runtime_error& error) {
    throw BadInput(error.what());
  }
}

realtime::BusAddress parse_bus(const std::string& url) {
  try {
    return realtime::parse_bus_url(url);
  } catch (const std::runtime_error& error) {
    throw BadInput(error.what());
  }
}

// Before the bus is opened: what an earlier process left in the interface's queue must not go out.
void restart_interface(const realtime::BusAddress& address) {
  if (address.transport != realtime::Transport::kSocketCan) {
    throw BadInput("--restart-interface needs --bus socketcan:INTERFACE; leave it out");
  }
  if (const std::string failure = realtime::restart_link(address.interface); !failure.empty()) {
    throw BadInput(failure);
  }
}

// The default folder is a convenience: where it cannot be made there are no flight records.
std::unique_ptr<FlightRecorder> open_flight_recorder(const Options& options, const LawFile& law) {
  const bool chosen = !options.flight_folder.empty();
  const std::string folder = chosen ? options.flight_folder : default_flight_folder();
  if (folder.empty() || folder == "none") return nullptr;
  try {
    return std::make_unique<FlightRecorder>(
        FlightSettings{.folder = folder,
                       .rig_name = law.meta().rig_name,
                       .law_sha256 = law.meta().inputs_sha256,
                       .bus_url = options.bus_url,
                       .period_s = law.config().model.period_s});
  } catch (const BadInput& error) {
    if (chosen) throw;
    spdlog::warn("no flight records: {}", error.what());
    return nullptr;
  }
}

void tell_ready(int fd) {
  if (fd < 0) return;
  constexpr std::string_view kReady = "ready\n";
  if (::write(fd, kReady.data(), kReady.size()) != static_cast<ssize_t>(kReady.size())) {
    spdlog::warn("nobody reads --ready-fd {}", fd);
  }
  ::close(fd);
}

// In real time: three soft-stop ramps, because a fault that holds the voltages first may have
// begun, and a second for the rest. In lock-step the plant may have ended already: a silence of
// kLockstepSilence means that no cycle comes any more.
void wait_for_rest(const realtime::ControlLoop& loop, std::uint64_t disarm_id,
                   double soft_stop_ramp_s, bool lockstep) {
  constexpr milliseconds kLockstepLimit{2000};
  constexpr milliseconds kLockstepSilence{300};  // user-mode Linux makes 500 cycles in a second
  const milliseconds realtime_limit(std::llround(1000.0 * (3.0 * soft_stop_ramp_s + 1.0)));
  const auto limit = steady_clock::now() + (lockstep ? kLockstepLimit : realtime_limit);
  std::int64_t cycles = loop.counters().cycles;
  auto silent_since = steady_clock::now();
  for (;;) {
    const realtime::LoopRecord newest = loop.newest();
    const bool never_ran = loop.counters().cycles == 0;
    if (newest.at_rest && (never_ran || newest.executed_command >= disarm_id)) return;
    const auto now = steady_clock::now();
    if (now >= limit) return;
    if (const std::int64_t cycles_now = loop.counters().cycles; cycles_now != cycles) {
      cycles = cycles_now;
      silent_since = now;
    }
    if (lockstep && now - silent_since >= kLockstepSilence) return;
    std::this_thread::sleep_for(milliseconds(1));
  }
}

// What `systemctl status` shows.
std::string status_line(const realtime::ControlLoop& loop) {
  const control::CycleRecord cycle = loop.newest().cycle;
  std::string line = std::string("STATUS=") + control::mode_text(cycle.mode);
  if (cycle.fault != control::Fault::kNone) {
    line += std::string(", ") + control::fault_text(cycle.fault);
  }
  return line;
}

// The signal; `meanwhile` runs once per interval until it comes.
int wait_for_signal(const sigset_t& signals, milliseconds interval,
                    const std::function<void()>& meanwhile) {
  const timespec limit{static_cast<time_t>(interval.count() / 1000),
                       static_cast<long>(interval.count() % 1000) * 1'000'000};
  for (;;) {
    const int signal_number = ::sigtimedwait(&signals, nullptr, &limit);
    if (signal_number > 0) return signal_number;
    meanwhile();
  }
}

}  // namespace

int run_daemon(const Options& options) {
  realtime::bound_memory();
  // Before the first thread: every thread inherits the mask, so that only this one sees the
  // signals.
  const sigset_t signals = stop_signals();
  ::pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  start_log(options.log_level);

  const ServiceManager manager = ServiceManager::from_environment();
  const LawFile law = LawFile::load(options.law_file);
  const control::ControllerConfig& config = law.config();
  check_rig(options, law.meta());

  const realtime::BusAddress address = parse_bus(options.bus_url);
  if (options.restart_interface) restart_interface(address);
  realtime::Bus bus = open_bus(address, config);
  const auto loop = std::make_unique<realtime::ControlLoop>(
      bus, config, realtime::LoopSettings{.lockstep = options.lockstep});

  const bool emulated_bus = address.transport == realtime::Transport::kUdpMulticast;
  OperatorDesk desk(
      *loop,
      {.law_sha256 = law.meta().inputs_sha256,
       .rig_name = law.meta().rig_name,
       .bus_url = options.bus_url,
       .arming_allowed = !emulated_bus || options.emulation,
       .arming_refusal =
           "arming on udp_multicast is for an emulated plant only; start eampcd with --emulation"});

  std::optional<Telemetry> telemetry;
  std::optional<ExternalReference> external;
  const std::string lcm_url = options.lcm_url.empty() ? law.meta().lcm_url : options.lcm_url;
  if (lcm_url != "none") {
    telemetry.emplace(lcm_url, law.meta().state_decimation);
    if (law.meta().reference_by_lcm) {
      external.emplace(config.safety.reference_angle_max_rad, config.model.period_s);
    }
  }
  std::optional<Recorder> recorder;
  if (!options.record_file.empty()) recorder.emplace(options.record_file);
  const std::unique_ptr<FlightRecorder> flight = open_flight_recorder(options, law);
  desk.set_flight_recorder(flight.get());
  RecordPump pump(*loop, desk, telemetry ? &*telemetry : nullptr, recorder ? &*recorder : nullptr,
                  external ? &*external : nullptr, flight.get());
  OperatorSocket socket(options.socket_path, desk, options.socket_for_group ? 0660 : 0600);
  std::function<std::string()> restart;
  if (options.restart_interface) {
    restart = [&] { return realtime::restart_link(address.interface); };
  }
  BusKeeper keeper(*loop, options.bus_url, std::move(restart));

  // What is loaded is locked now, what the threads below still need when it is mapped.
  const realtime::RealtimeState memory = realtime::lock_memory(options.realtime);
  ControlThread control_thread(*loop, options.realtime);
  const realtime::RealtimeState scheduling = control_thread.start();
  const std::string realtime_text = scheduling.text + ", " + memory.text;
  desk.set_realtime_text(realtime_text);
  if (!memory.achieved || !scheduling.achieved) {
    if (options.realtime.request == realtime::RealtimeRequest::kEnforce) {
      throw std::runtime_error("real time was refused: " + realtime_text +
                               "; grant the capabilities, or use --realtime warn");
    }
    spdlog::warn("no real time: {}", realtime_text);
  }
  pump.start();
  keeper.start();
  socket.start();
  control_thread.begin();
  spdlog::info("rig {} on {}, T = {} ms, {}; operator socket {}", law.meta().rig_name,
               options.bus_url, 1000.0 * config.model.period_s, realtime_text, options.socket_path);
  tell_ready(options.ready_fd);

  manager.notify("READY=1\n" + status_line(*loop));
  LoopWatchdog watchdog(manager, [&] { return loop->turns(); });
  const int signal_number = wait_for_signal(signals, watchdog.interval(), [&] {
    if (watchdog.feed()) manager.notify(status_line(*loop));
  });
  spdlog::info("{}: bringing the joint to rest", ::strsignal(signal_number));
  manager.notify("STOPPING=1");
  socket.stop();
  const std::uint64_t disarm_id = desk.disarm();
  wait_for_rest(*loop, disarm_id, config.safety.soft_stop_ramp_s, options.lockstep);
  keeper.stop();
  control_thread.stop();
  pump.stop();

  const realtime::LoopCounters counters = loop->counters();
  spdlog::info("stopped after {} cycles: {} missed, {} overruns, {} invalid, {} send errors",
               counters.cycles, counters.missed_cycles(), counters.deadline_overruns,
               counters.invalid_frames, counters.send_errors);
  return loop->newest().at_rest ? 0 : 1;
}

}  // namespace eampc::service
