// The plane of a facet, and polytopes within it: one coordinate is eliminated.
#pragma once

#include <span>

#include "law_design/half_spaces.hpp"
#include "law_design/largest_ball.hpp"
#include "law_design/polytope.hpp"

namespace eampc::law_design {

/// A polytope in a plane, in np−1 coordinates; the box of these is implied.
struct FacetPiece {
  HalfSpaces rows{0};  // unit
  bool empty = false;
};

/// normal·q = offset, |normal| = 1. Conditions are np + 1 numbers, form·(q, 1) ≥ 0.
class FacetPlane {
 public:
  explicit FacetPlane(int parameters);

  void set(const double* normal, double offset);
  double normal(int j) const { return normal_[static_cast<std::size_t>(j)]; }

  /// What the box leaves of the plane.
  FacetPiece whole() const;
  /// Adds a condition.
  void append(FacetPiece& piece, const long double* form) const;
  /// Adds form ≥ 0 as it is not in this plane but above it along the normal, where exit·(q, 1) is
  /// 0; exit falls along the normal.
  void append_above(FacetPiece& piece, const long double* form, const long double* exit) const;
  /// Upper bound of the radius of the largest ball in the plane; −1: empty.
  double radius(const FacetPiece& piece);

  /// Sum of the absolute coefficients of a form that the best multiple of another leaves of it.
  static double residual(std::span<const double> form, std::span<const double> plane);

  long lp_count() const { return ball_.lp_count(); }

 private:
  int parameters_;
  Point normal_{};
  double offset_ = 0.0;
  int eliminated_ = 0;
  LargestBall ball_;
};

}  // namespace eampc::law_design
