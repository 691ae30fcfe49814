// Any bytes as one request of the operator protocol. What is accepted must be obeyable: its
// reference runs through an ACTIVE control cycle without a fault.
#include "fuzz/checked_cycle.hpp"
#include "fuzz/fuzz_configurations.hpp"
#include "service/operator_request.hpp"
#include "service/options.hpp"

namespace {

using eampc::fuzz::require;
using eampc::service::OperatorRequest;

void follow(const eampc::control::ReferenceTrajectory& reference) {
  const eampc::control::ControllerConfig& config = eampc::fuzz::joints()[1].config;
  eampc::fuzz::CheckedCycle cycle(config);
  constexpr int kCycles = 40;
  for (int i = 0; i < kCycles; ++i) {
    const eampc::control::Frame frame =
        eampc::control::encode_encoder_frame(config.encoder, 0.1, 0.0, 0, 0);
    eampc::control::CycleInput input;
    input.encoder_frame = &frame;
    input.bus.queue_proved_empty = true;
    if (i == 2) input.action = eampc::control::OperatorAction::kArm;
    if (i == 3) input.new_reference = &reference;
    const auto record = cycle.step(input).record;
    if (i > 3) {
      require(record.mode == eampc::control::Mode::kActive,
              "an accepted reference never stops the joint");
    }
  }
}

void check(const OperatorRequest& request) {
  require(request.at_cycle >= -1, "at_cycle is -1 or a cycle");
  require(request.table.size() <= eampc::service::kMaxTableRows, "a table has a longest length");
  for (const auto& row : request.table) {
    require(std::isfinite(row.angle_rad) && std::isfinite(row.velocity_rad_s) &&
                std::isfinite(row.acceleration_rad_s2),
            "a table is finite");
  }
  if (request.command != eampc::service::Command::kReference) return;
  eampc::control::ReferenceTrajectory reference = request.reference;
  require((reference.kind == eampc::control::ReferenceKind::kTable) == !request.table.empty(),
          "a table and its kind go together");
  reference.table = request.table.empty() ? nullptr : request.table.data();
  reference.samples = static_cast<std::int32_t>(request.table.size());
  follow(reference);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    check(eampc::service::parse_request({data, size}));
  } catch (const eampc::service::BadInput& error) {
    const std::string sentence = error.what();
    require(sentence.size() > 10, "a refused request is told why");
    for (const char c : sentence) require(c >= ' ' && c <= '~', "a refusal is printable");
  }
  return 0;
}
