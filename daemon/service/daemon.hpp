// Puts the parts together, waits for SIGTERM or SIGINT, and brings the joint to rest before it
// returns.
#pragma once

#include "service/options.hpp"

namespace eampc::service {

// The exit code: 0 orderly, 1 failure while running. Throws BadInput or LawFileError before
// anything has moved.
int run_daemon(const Options& options);

}  // namespace eampc::service
