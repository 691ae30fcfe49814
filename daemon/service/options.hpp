// The daemon's command line.
#pragma once

#include <stdexcept>
#include <string>

#include "realtime/realtime_setup.hpp"

namespace eampc::service {

// Wrong input, found before anything moves: one sentence that says what, where, and how to put it
// right. Exit code 2.
class BadInput : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct Options {
  std::string law_file;
  std::string bus_url;
  std::string rig;          // folder or rig.toml; empty: not checked
  std::string socket_path;  // never empty after parsing
  bool socket_for_group = false;
  bool emulation = false;
  bool lockstep = false;
  bool restart_interface = false;
  realtime::RealtimeSettings realtime;
  std::string lcm_url;  // empty: as the law file says; "none": no LCM
  std::string record_file;
  std::string flight_folder;  // "none": no flight records; empty: default_flight_folder()
  std::string log_level = "info";
  int ready_fd = -1;
};

struct ParsedOptions {
  Options options;
  std::string text;  // --help or --version: to be printed, nothing else to be done
};

// Throws BadInput.
ParsedOptions parse_options(int argc, const char* const* argv);

// $EAMPC_SOCKET, else $XDG_RUNTIME_DIR/eampcd.sock, else /tmp/eampcd-<uid>.sock.
std::string default_socket_path();

}  // namespace eampc::service
