// The network interface under a CAN bus: taken down and up, which empties the interface's queue and
// the controller, and ends bus-off. For an ordinary thread: a driver may take a while.
#pragma once

#include <string>

namespace eampc::realtime {

// Empty if done (needs CAP_NET_ADMIN), else one sentence. An interface that is down already stays
// down: somebody wants it so.
std::string restart_link(const std::string& interface);

}  // namespace eampc::realtime
