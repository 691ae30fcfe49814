#include "service/options.hpp"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <map>
#include <sstream>

namespace eampc::service {

std::string default_socket_path() {
  const char* chosen = std::getenv("EAMPC_SOCKET");
  if (chosen != nullptr && *chosen != '\0') return chosen;
  const char* runtime_folder = std::getenv("XDG_RUNTIME_DIR");
  if (runtime_folder != nullptr && *runtime_folder != '\0') {
    return std::string(runtime_folder) + "/eampcd.sock";
  }
  return "/tmp/eampcd-" + std::to_string(::getuid()) + ".sock";
}

namespace {

// The names of the values stand in the option's type already.
CLI::Validator silent(CLI::Validator validator) {
  validator.description("");
  return validator;
}

}  // namespace

ParsedOptions parse_options(int argc, const char* const* argv) {
  ParsedOptions parsed;
  Options& options = parsed.options;
  CLI::App app{
      "Explicit adaptive MPC of a pneumatic-muscle joint: one encoder frame in, one valve frame "
      "out, every period.\n"
      "Starts DISARMED with both valves at their safe voltage; arm it with `eampc arm`.",
      "eampcd"};
  app.get_formatter()->column_width(28);
  app.failure_message(CLI::FailureMessage::simple);
  app.footer(
      "Stop with SIGTERM or SIGINT: the joint is brought to rest first.\n"
      "Exit codes: 0 orderly stop, 1 failure while running, 2 bad input.\n"
      "Example: eampcd --law reference.law --bus udp_multicast: --emulation");

  const std::map<std::string, realtime::RealtimeRequest> requests{
      {"enforce", realtime::RealtimeRequest::kEnforce},
      {"warn", realtime::RealtimeRequest::kWarn},
      {"off", realtime::RealtimeRequest::kOff}};
  std::string request = "warn";

  app.add_option("--law", options.law_file, "Law file written by `eampc design` (required)")
      ->type_name("FILE");
  app.add_option("--bus", options.bus_url,
                 "socketcan:INTERFACE, or udp_multicast:GROUP:PORT for emulation (required)")
      ->type_name("URL");
  app.add_option("--rig", options.rig, "Rig folder or rig.toml the law must belong to")
      ->type_name("DIR|FILE");
  app.add_option(
         "--socket", options.socket_path,
         "Operator socket [$EAMPC_SOCKET, $XDG_RUNTIME_DIR/eampcd.sock or /tmp/eampcd-UID.sock]")
      ->type_name("PATH");
  app.add_flag("--socket-for-group", options.socket_for_group,
               "Let the group of the operator socket operate too (mode 0660 instead of 0600)");
  app.add_flag("--emulation", options.emulation,
               "The plant is an emulator: allow arming on udp_multicast, and --lockstep");
  app.add_flag("--lockstep", options.lockstep,
               "Time is counted in encoder frames; no wall-clock time-outs (needs --emulation)");
  app.add_flag("--restart-interface", options.restart_interface,
               "Take the CAN interface down and up at the start, and whenever it may still hold an "
               "old command or is bus-off (needs CAP_NET_ADMIN)");
  app.add_option("--realtime", request,
                 "enforce: fail without SCHED_FIFO and locked memory; warn; off")
      ->check(silent(CLI::IsMember(requests)))
      ->type_name("enforce|warn|off")
      ->capture_default_str();
  app.add_option("--cpu", options.realtime.cpu, "Pin the control thread to this processor")
      ->check(silent(CLI::Range(0, 1023)))
      ->type_name("N");
  app.add_option("--priority", options.realtime.priority,
                 "SCHED_FIFO priority of the control thread, 1 to 99")
      ->check(silent(CLI::Range(1, 99)))
      ->type_name("N")
      ->capture_default_str();
  app.add_option("--lcm-url", options.lcm_url, "LCM network, or none [as the law file says]")
      ->type_name("URL|none");
  app.add_option("--record", options.record_file, "Write every cycle to this CSV file")
      ->type_name("FILE");
  app.add_option("--flight-folder", options.flight_folder,
                 "Where a fault leaves its last cycles [$STATE_DIRECTORY, $XDG_STATE_HOME/eampc or "
                 "~/.local/state/eampc]")
      ->type_name("DIR|none");
  app.add_option("--log-level", options.log_level, "What goes to standard error")
      ->check(silent(CLI::IsMember({"debug", "info", "warning", "error", "off"})))
      ->type_name("debug|info|warning|error|off")
      ->capture_default_str();
  app.add_option("--ready-fd", options.ready_fd,
                 "Write \"ready\" and a newline to this descriptor once bus and socket are up")
      ->check(silent(CLI::Range(0, 1 << 20)))
      ->type_name("N");
  app.set_version_flag("--version", std::string("eampcd ") + EAMPC_VERSION);

  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {
    std::ostringstream text, unused;
    app.exit(asked, text, unused);
    parsed.text = text.str();
    return parsed;
  } catch (const CLI::ParseError& error) {
    throw BadInput(std::string(error.what()) + " (see eampcd --help)");
  }

  // Not CLI11's own requirement: it would hide a misspelt option behind the missing one.
  if (options.law_file.empty()) throw BadInput("--law FILE is missing (see eampcd --help)");
  if (options.bus_url.empty()) throw BadInput("--bus URL is missing (see eampcd --help)");
  options.realtime.request = requests.at(request);
  if (options.lockstep && !options.emulation) {
    throw BadInput(
        "--lockstep counts time in encoder frames and is for an emulated plant; add --emulation");
  }
  if (options.socket_path.empty()) options.socket_path = default_socket_path();
  return parsed;
}

}  // namespace eampc::service
