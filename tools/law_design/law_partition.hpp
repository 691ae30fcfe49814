// The parameter set divided by the affine output that holds: every critical region with its law,
// saturated ones with one of the two bounds, and the hyperplanes on which laws meet.
//
// Everything is scaled: parameters to ±1, outputs so that y_min is 0 and y_max is 1.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cstddef>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/polytope.hpp"

namespace eampc::law_design {

/// y = c[0..np)·q + c[kMaxDimension], scaled.
using ScaledLaw = std::array<double, kMaxDimension + 1>;

struct Hyperplane {
  Point normal{};
  double offset = 0.0;

  double excess(const Point& q) const {
    double sum = -offset;
    for (std::size_t j = 0; j < kMaxDimension; ++j) sum += normal[j] * q[j];
    return sum;
  }
};

/// Extent of a polytope: a box around it and points of it.
struct Extent {
  Point lower{}, upper{};
  std::vector<Point> points;
};

struct LawRegion {
  HalfSpaces facets{0};       ///< in q
  HalfSpaces ball_facets{0};  ///< the same rows over (q, r): a·q + r ≤ b
  std::vector<int> planes;    ///< of the facets beyond which another law, or none, holds
  int law = 0;
  Point inside{};       ///< centre of the largest ball …
  double radius = 0.0;  ///< … and its radius
  Extent extent;
};

struct LawPartition {
  int parameters = 0;
  Eigen::VectorXd centre, half_width;
  double y_min = 0.0, y_max = 0.0;
  std::vector<LawRegion> regions;
  /// Distinct to 1e-9 of the output's range over the box. The last two are the bounds.
  std::vector<ScaledLaw> laws;
  std::vector<Hyperplane> planes;  ///< each once, whichever side its region is on
  int unsaturated_regions = 0;
  bool everywhere_feasible = true;

  int low_law() const { return static_cast<int>(laws.size()) - 2; }
  int high_law() const { return static_cast<int>(laws.size()) - 1; }
  bool is_bound(int law) const { return law >= low_law(); }
  double value(int law, const double* q) const {
    const ScaledLaw& c = laws[static_cast<std::size_t>(law)];
    double y = c[kMaxDimension];
    for (int j = 0; j < parameters; ++j) y += c[static_cast<std::size_t>(j)] * q[j];
    return y;
  }
};

/// Throws std::invalid_argument if the output's shapes or bounds make no sense.
LawPartition partition_by_law(const MpQpSolution& solution, const OutputLaw& output);

/// The hyperplane in the problem's own parameters: unit normal, offset in the last entry.
Eigen::VectorXd in_problem_units(const Hyperplane& plane, const LawPartition& partition);
/// The law in the problem's own parameters and outputs: gain, offset in the last entry.
Eigen::VectorXd in_problem_units(const ScaledLaw& law, const LawPartition& partition);

}  // namespace eampc::law_design
