// The scalar path: any processor, one double at a time.
#define EAMPC_LANE_WIDTH 1
#include "control/point_location_kernel.hpp"
#include "control/point_location_paths.hpp"

namespace eampc::control::paths {

PackedLaw::Function scalar(int n_parameters, LawShape shape) noexcept {
  return function_of(n_parameters, shape);
}

}  // namespace eampc::control::paths
