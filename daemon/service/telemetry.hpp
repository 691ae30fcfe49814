// What everyone else sees: EAMPC_STATE per cycle (decimated), EAMPC_HEALTH once per second; and,
// only if the law file says so, EAMPC_REFERENCE in. All calls come from the record pump's thread,
// except the constructor.
#pragma once

#include <cstdint>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <string>

#include "eampc_lcm/health_t.hpp"
#include "eampc_lcm/reference_t.hpp"
#include "eampc_lcm/state_t.hpp"
#include "realtime/control_loop.hpp"
#include "service/operator_request.hpp"

namespace eampc::service {

class Telemetry {
 public:
  using ReferenceHandler = std::function<void(const control::Reference&, std::int64_t utime)>;

  // Throws BadInput if the network cannot be reached.
  Telemetry(const std::string& lcm_url, std::int32_t state_decimation);

  // Before the pump starts: a first subscription may take seconds in LCM's self-test.
  void subscribe_reference(ReferenceHandler handler);

  void publish_state(const realtime::LoopRecord& record);
  // `status` is the same answer an operator would get.
  void publish_health(const OperatorReply& status);
  // Hands waiting references to the handler; waits at most this long for one.
  void receive(int wait_ms);

 private:
  // Twice what LCM keeps for us: a flooding sender must not hold up records and the stop.
  static constexpr int kMaxReferencesPerTurn = 16;

  struct Destroyer {
    void operator()(lcm_t* lcm) const noexcept { ::lcm_destroy(lcm); }
  };
  // The C++ wrapper does not own a handle that it did not open itself.
  std::unique_ptr<lcm_t, Destroyer> handle_;
  lcm::LCM lcm_;
  const std::int32_t state_decimation_;
  bool subscribed_ = false;
  eampc_lcm::state_t state_{};  // kept, so that its strings keep their storage
};

}  // namespace eampc::service
