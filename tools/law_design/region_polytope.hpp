// Facets of a polytope in [-1, 1]^n for the certificate: every row left out is proved redundant by
// a linear program (or by the box), so what remains is the polytope itself.
#pragma once

#include <array>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/largest_ball.hpp"
#include "law_design/linear_program.hpp"
#include "law_design/polytope.hpp"

namespace eampc::law_design {

struct RegionPolytope {
  HalfSpaces facets{0};        ///< unit rows; the box is implied and not among them
  std::vector<int> labels;     ///< where each facet came from
  std::vector<Point> touched;  ///< a point of each facet, to rounding
  Point centre{};              ///< of a largest ball
  double radius = -1.0;        ///< of that ball; negative: empty
};

class RegionPolytopeMaker {
 public:
  /// Deepest part of a region with radius 1e-8 or more that leaving out a row may have added.
  static constexpr double kCut = 1e-10;

  explicit RegionPolytopeMaker(int dimension);

  /// Finds the largest ball in `rows` (unit normals) and the box. False, with centre and radius
  /// only, if its radius is below `least_radius`; else also the facets.
  bool make(const HalfSpaces& rows, const std::vector<int>& labels, double least_radius,
            RegionPolytope& result);

  long lp_count() const { return ball_.lp_count() + support_.count(); }

 private:
  int first_hit(const Point& direction, double* distance, bool* clear);
  void accept(int row, const Point& point, RegionPolytope& result);

  int dimension_;
  LargestBall ball_;
  LinearProgram support_;
  HalfSpaces rows_;
  std::vector<int> labels_;
  std::vector<double> slack_;
  std::vector<char> known_;
};

}  // namespace eampc::law_design
