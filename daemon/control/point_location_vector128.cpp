// The 128-bit path: SSE2 and NEON, which every x86-64 and aarch64 processor has.
#define EAMPC_LANE_WIDTH 2
#include "control/point_location_kernel.hpp"
#include "control/point_location_paths.hpp"

namespace eampc::control::paths {

PackedLaw::Function vector128(int n_parameters, LawShape shape) noexcept {
  return function_of(n_parameters, shape);
}

}  // namespace eampc::control::paths
