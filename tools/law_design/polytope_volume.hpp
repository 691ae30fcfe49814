// Exact volume of a polytope in [-1, 1]^n, n ≤ 3, by cones over its facets: V = Σ h_i A_i / n.
#pragma once

#include "law_design/half_spaces.hpp"

namespace eampc::law_design {

/// The number of terms grows with the factorial of the dimension.
inline constexpr int kMostVolumeDimensions = 3;

/// `rows` have unit normals; redundant ones do no harm. The box is implied.
double polytope_volume(const HalfSpaces& rows);

}  // namespace eampc::law_design
