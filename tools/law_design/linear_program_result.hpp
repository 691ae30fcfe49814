// What a linear program answers.
#pragma once

#include <limits>

namespace eampc::law_design {

enum class LpStatus {
  kOptimal,      ///< point() is optimal
  kBelowCutoff,  ///< proved max c·x ≤ cutoff; point() is not feasible
  kInfeasible,   ///< proved: no point satisfies every row
  kFailed,       ///< nothing is proved
};

struct LpResult {
  LpStatus status = LpStatus::kFailed;
  /// Of c·x: an upper bound where kOptimal or kBelowCutoff (and c·point() up to the tolerance).
  double value = std::numeric_limits<double>::infinity();
};

}  // namespace eampc::law_design
