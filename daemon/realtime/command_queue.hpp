// What the operator's side hands to the control loop.
#pragma once

#include <cstdint>

#include "control/control_types.hpp"
#include "control/reference_trajectory.hpp"
#include "realtime/record_queue.hpp"

namespace eampc::realtime {

struct LoopCommand {
  std::uint64_t id = 0;  // rises by one per command; the snapshot says which was executed last
  std::int64_t at_cycle = -1;  // the cycle to be executed in; -1: the next one
  control::OperatorAction action = control::OperatorAction::kNone;
  bool has_reference = false;
  control::ReferenceTrajectory reference;
};

// An operator types; 64 is more than a script sends before the next period takes them out.
using CommandQueue = RecordQueue<LoopCommand, 64>;
// Reference tables the loop no longer reads, on their way back to their owner. More than can wait
// in the command queue and in the loop together (64 + 32): none is ever lost.
using ReleasedTableQueue = RecordQueue<const control::Reference*, 128>;

}  // namespace eampc::realtime
