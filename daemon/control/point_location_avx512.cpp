// The AVX-512 path; the build compiles this file with -mavx512f -mavx512dq -mavx512vl.
#define EAMPC_LANE_WIDTH 8
#include "control/point_location_kernel.hpp"
#include "control/point_location_paths.hpp"

namespace eampc::control::paths {

PackedLaw::Function avx512(int n_parameters, LawShape shape) noexcept {
  return function_of(n_parameters, shape);
}

}  // namespace eampc::control::paths
