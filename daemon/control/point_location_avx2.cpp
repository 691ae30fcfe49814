// The AVX2 path; the build compiles this file with -mavx2.
#define EAMPC_LANE_WIDTH 4
#include "control/point_location_kernel.hpp"
#include "control/point_location_paths.hpp"

namespace eampc::control::paths {

PackedLaw::Function avx2(int n_parameters, LawShape shape) noexcept {
  return function_of(n_parameters, shape);
}

}  // namespace eampc::control::paths
