#include "control/point_location.hpp"

#include "control/point_location_paths.hpp"

namespace eampc::control {
namespace {

bool processor_has(EvaluationPath path) noexcept {
#if defined(__x86_64__)
  if (path == EvaluationPath::kAvx2) return __builtin_cpu_supports("avx2") != 0;
  if (path == EvaluationPath::kAvx512) {
    return __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512dq") != 0 &&
           __builtin_cpu_supports("avx512vl") != 0;
  }
  return true;
#else
  return path == EvaluationPath::kScalar || path == EvaluationPath::kVector128;
#endif
}

}  // namespace

PackedLaw::Function evaluation(int n_parameters, LawShape shape, EvaluationPath path) noexcept {
  if (path == EvaluationPath::kBest) {
    path = EvaluationPath::kVector128;
    for (const EvaluationPath wider : {EvaluationPath::kAvx2, EvaluationPath::kAvx512}) {
      if (processor_has(wider)) path = wider;
    }
  }
  if (!processor_has(path)) return nullptr;
  switch (path) {
#if defined(__x86_64__)
    case EvaluationPath::kAvx512:
      return paths::avx512(n_parameters, shape);
    case EvaluationPath::kAvx2:
      return paths::avx2(n_parameters, shape);
#endif
    case EvaluationPath::kVector128:
      return paths::vector128(n_parameters, shape);
    default:
      return paths::scalar(n_parameters, shape);
  }
}

}  // namespace eampc::control
