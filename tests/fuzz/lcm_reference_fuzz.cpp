// Any bytes as EAMPC_REFERENCE messages in a row: LCM's own decoding, the gate (range, rate, age),
// and the control cycle that follows what passed. Per message: 2 bytes of elapsed milliseconds,
// then what the network brought.
#include <cmath>

#include "eampc_lcm/reference_t.hpp"
#include "fuzz/checked_cycle.hpp"
#include "fuzz/fuzz_configurations.hpp"
#include "service/external_reference.hpp"

namespace {

using eampc::control::Reference;
using eampc::fuzz::require;
using eampc::service::ExternalReference;

void check(const Reference& reference, double angle_max_rad) {
  require(std::isfinite(reference.angle_rad) && std::isfinite(reference.velocity_rad_s) &&
              std::isfinite(reference.acceleration_rad_s2),
          "a followed reference is finite");
  require(std::abs(reference.angle_rad) <= angle_max_rad, "a followed reference is in range");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const eampc::control::ControllerConfig& config = eampc::fuzz::joints()[1].config;
  const double angle_max_rad = config.safety.reference_angle_max_rad;
  ExternalReference gate(angle_max_rad, config.model.period_s);
  eampc::fuzz::CheckedCycle cycle(config);
  eampc::fuzz::ByteReader bytes(data, size);
  constexpr std::int64_t kStart_us = 1'000'000'000;
  std::int64_t now_us = kStart_us, followed_us = 0;
  while (!bytes.at_end()) {
    const std::int64_t elapsed_us = 1000 * std::int64_t{bytes.take<std::uint16_t>()};
    now_us += elapsed_us;
    const auto message = bytes.take_bytes(bytes.take<std::uint8_t>());
    eampc_lcm::reference_t sample{};
    const int used = sample.decode(message.data(), 0, static_cast<int>(message.size()));
    require(used <= static_cast<int>(message.size()), "a message ends where its bytes end");

    eampc::control::ReferenceTrajectory trajectory;
    trajectory.kind = eampc::control::ReferenceKind::kExternal;
    std::optional<Reference> followed;
    if (used >= 0) {
      // Small numbers are offsets of the present: a fuzzer would not find the clock.
      const bool relative = std::llabs(sample.utime % INT64_MAX) < kStart_us;
      const std::int64_t utime = relative ? now_us + sample.utime : sample.utime;
      followed = gate.accept({sample.angle_rad, sample.velocity_rad_s, sample.acceleration_rad_s2},
                             utime, now_us);
      if (followed) {
        require(utime >= now_us - ExternalReference::kExpiryUs &&
                    utime <= now_us + ExternalReference::kExpiryUs,
                "an old or future reference is not followed");
        require(now_us - followed_us >= std::llround(1e6 * config.model.period_s),
                "at most one reference per period is followed");
        followed_us = now_us;
      }
    }
    if (!followed) {
      followed = gate.expire(now_us);
      if (followed) {
        require(followed->velocity_rad_s == 0.0 && followed->acceleration_rad_s2 == 0.0,
                "an expired reference stands still");
      }
    }
    const eampc::control::Frame frame =
        eampc::control::encode_encoder_frame(config.encoder, 0.1, 0.0, 0, 0);
    eampc::control::CycleInput input;
    input.encoder_frame = &frame;
    input.bus.queue_proved_empty = true;
    input.action = eampc::control::OperatorAction::kArm;
    if (followed) {
      check(*followed, angle_max_rad);
      trajectory.external = *followed;
      input.new_reference = &trajectory;
    }
    cycle.step(input);
  }
  return 0;
}
