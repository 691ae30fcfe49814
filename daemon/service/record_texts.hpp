// What a record's bits and numbers say, in words: for telemetry, status and the operator.
#pragma once

#include <cstdint>
#include <string>

#include "control/control_types.hpp"

namespace eampc::service {

std::string limits_text(std::uint32_t limits);      // "none" or texts with their keys
std::string causes_text(control::FaultSet causes);  // "none" or "encoder_timeout, link_down"
// "none", or why an edge was not obeyed, with the cause that stands behind it.
std::string refusal_sentence(control::Refusal refusal, control::Fault cause);

}  // namespace eampc::service
