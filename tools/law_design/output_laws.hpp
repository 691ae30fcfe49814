// The distinct affine outputs of an explicit solution and the polytopes on which they hold,
// without the saturated ones.
//
// Everything is scaled: parameters to ±1, outputs so that y_min is 0 and y_max is 1.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/polytope.hpp"

namespace eampc::law_design {

/// y = c[0..np)·q + c[kMaxDimension], scaled.
using ScaledLaw = std::array<double, kMaxDimension + 1>;

struct LawRegion {
  HalfSpaces facets{0};       ///< in q
  HalfSpaces ball_facets{0};  ///< the same rows over (q, r): a·q + r ≤ b
  /// Facets worth splitting on: beyond them another law holds.
  std::vector<int> law_facets;
  /// Facets beyond which no unsaturated region was seen.
  std::vector<int> outer_facets;
  int law = 0;
  Point inside{};
};

struct OutputLaws {
  int parameters = 0;
  Eigen::VectorXd centre, half_width;
  std::vector<LawRegion> regions;  ///< those whose output is not saturated throughout
  std::vector<ScaledLaw> laws;     ///< distinct to 1e-9 of the output's range over the box
  int saturated_low = 0;           ///< regions left out at y_min …
  int saturated_high = 0;          ///< … and at y_max

  double value(int law, const double* q) const {
    const ScaledLaw& c = laws[static_cast<std::size_t>(law)];
    double y = c[kMaxDimension];
    for (int j = 0; j < parameters; ++j) y += c[static_cast<std::size_t>(j)] * q[j];
    return y;
  }
};

/// Throws std::invalid_argument if the output's shapes or bounds make no sense.
OutputLaws distinct_output_laws(const MpQpSolution& solution, const OutputLaw& output);

}  // namespace eampc::law_design
