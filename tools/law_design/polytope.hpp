// Bounded polytope {x : a_i·x ≤ b_i} inside the box [-1, 1]^n: centre, irredundant facets and one
// point on each facet.
#pragma once

#include <array>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/linear_program.hpp"

namespace eampc::law_design {

/// Most parameters a law may have; as in daemon/control/point_location.hpp.
inline constexpr int kMaxDimension = 8;
using Point = std::array<double, kMaxDimension>;

/// Label of facets that belong to the box.
inline constexpr int kBoxLabel = -1;

struct Polytope {
  HalfSpaces facets{0};             ///< irredundant, unit normals, facets of the box last
  std::vector<int> labels;          ///< label of the row each facet came from, or kBoxLabel
  std::vector<Point> facet_points;  ///< a point of each facet (of the polytope, to rounding)
  Point centre{};                   ///< centre of a largest ball
  double radius = 0.0;              ///< of that ball
};

class PolytopeReducer {
 public:
  explicit PolytopeReducer(int dimension);

  /// Reduces unit `rows` (the box is implied) to facets. False if the polytope holds no ball of
  /// radius `least_radius` > 0; `result` is then meaningless.
  bool reduce(const HalfSpaces& rows, const std::vector<int>& labels, double least_radius,
              Polytope& result);
  /// The first part of reduce(): only whether there is such a ball.
  bool holds_ball(const HalfSpaces& rows, const std::vector<int>& labels, double least_radius);

  long lp_count() const { return ball_.count() + support_.count(); }
  LinearProgram& support() { return support_; }

 private:
  struct Hit {
    int row = -1;
    double distance = 0.0;
    bool clear = false;  // no other row within rounding of the hit
  };
  Hit shoot(const double* direction);
  void accept(int row, const Point& on_facet, bool clear, Polytope& result);
  void drop_redundant(Polytope& result);

  int dimension_;
  LinearProgram ball_, support_;
  HalfSpaces ball_rows_, rows_;
  std::vector<int> labels_;
  std::vector<double> slack_, speed_;
  std::vector<char> state_;
  HalfSpaces found_;
  int own_rows_ = 0;
  double cut_ = 0.0;           // what a row must cut off to be a facet
  std::vector<int> doubtful_;  // facets that may touch the polytope in less than a facet
};

}  // namespace eampc::law_design
