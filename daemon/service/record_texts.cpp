#include "service/record_texts.hpp"

#include <cstddef>

namespace eampc::service {
namespace {

void append(std::string& list, const char* text) {
  if (!list.empty()) list += ", ";
  list += text;
}

}  // namespace

std::string limits_text(std::uint32_t limits) {
  std::string text;
  for (std::uint32_t bit = 1; bit != 0; bit <<= 1) {
    if ((limits & bit) != 0) append(text, control::limit_text(static_cast<control::Limit>(bit)));
  }
  return text.empty() ? control::limit_text(control::kLimitNone) : text;
}

std::string causes_text(control::FaultSet causes) {
  std::string text;
  for (std::size_t number = 1; number < control::kFaultCount; ++number) {
    const auto fault = static_cast<control::Fault>(number);
    if (causes.has(fault)) append(text, control::fault_name(fault));
  }
  return text.empty() ? control::fault_name(control::Fault::kNone) : text;
}

std::string refusal_sentence(control::Refusal refusal, control::Fault cause) {
  std::string text = control::refusal_text(refusal);
  if (cause != control::Fault::kNone) text += std::string(": ") + control::fault_text(cause);
  return text;
}

}  // namespace eampc::service
