// The operator protocol's messages: 4 bytes little-endian length, then a MessagePack map.
// Everything that comes in is checked here, so that what is handed on is valid.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "control/reference_trajectory.hpp"
#include "realtime/control_loop.hpp"

namespace eampc::service {

// A table of 60,000 rows of three doubles (300 s at 200 Hz) and its keys; locked memory is scarce.
inline constexpr std::size_t kMaxTableRows = 60'000;
inline constexpr std::size_t kMaxRequestBytes = kMaxTableRows * 24 + 1024;

enum class Command : std::uint8_t { kArm, kDisarm, kReset, kStatus, kReference, kFlight };

struct OperatorRequest {
  Command command = Command::kStatus;
  std::int64_t at_cycle = -1;
  control::ReferenceTrajectory reference;  // of kReference, without its table
  std::vector<control::Reference> table;   // kTable
};

// Throws BadInput with one sentence.
OperatorRequest parse_request(std::span<const std::uint8_t> message);

struct OperatorReply {
  bool ok = true;
  std::string message;
  control::Refusal refusal = control::Refusal::kNone;  // of the last arm or reset not obeyed
  control::Fault refusal_cause = control::Fault::kNone;
  realtime::LoopRecord newest;
  realtime::LoopCounters counters;
  double arrival_to_sent_p50_us = 0.0;
  double arrival_to_sent_p99_us = 0.0;
  double arrival_to_sent_max_us = 0.0;
  std::string law_sha256;
  std::string rig_name;
  std::string bus;
  std::string realtime_text;
};

// Length prefix included.
std::vector<std::uint8_t> pack_reply(const OperatorReply& reply);

}  // namespace eampc::service
