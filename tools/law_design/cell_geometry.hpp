// Questions about a cell of the search structure and the part of a region inside it, answered by
// linear programs.
#pragma once

#include <array>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/law_partition.hpp"
#include "law_design/linear_program.hpp"

namespace eampc::law_design {

/// The half-spaces of a cell, in q and over (q, r).
class Cell {
 public:
  explicit Cell(int dimension) : dimension_(dimension), rows_(dimension), ball_(dimension + 1) {}
  /// Enters the side of a hyperplane; pop() leaves it again.
  void push(const Hyperplane& plane, bool above);
  void pop();
  const HalfSpaces& rows() const { return rows_; }
  const HalfSpaces& ball_rows() const { return ball_; }

 private:
  int dimension_;
  HalfSpaces rows_, ball_;
};

/// The part of a region that lies in a cell.
struct CellItem {
  int region = 0;
  bool thin = false;    ///< no ball of radius kThin: not counted, but checked at the leaf
  Point inside{};       ///< centre of a ball in region ∩ cell …
  double radius = 0.0;  ///< … and its radius
  Extent extent;        ///< a box around region ∩ cell, and points of it
};

class CellGeometry {
 public:
  /// Regions whose part in a cell holds no ball of this radius are thin.
  static constexpr double kThin = 1e-10;
  /// Regions that reach less than this into a cell only touch it: facets of neighbours agree to no
  /// more than their rounding.
  static constexpr double kTouch = 1e-11;
  /// A region that reaches less than this beyond a hyperplane is on one side of it.
  static constexpr double kSide = 1e-10;

  explicit CellGeometry(const LawPartition& partition);

  enum class Presence { kAbsent, kThin, kThere };
  /// Whether the item reaches into `cell`; sets its inside and radius.
  Presence presence(const Cell& cell, CellItem& item);
  /// Adds extreme points of region ∩ cell and tightens the box.
  void refresh_extent(const Cell& cell, CellItem& item);

  /// max of law a − law b over region ∩ cell is at most `bound`.
  bool difference_below(int law_a, int law_b, const CellItem& item, const Cell& cell, double bound);
  /// The same where the output of the region's own law is inside its range: clear of y_max by
  /// `bound` if it is law b, of y_min if it is law a.
  bool clipped_difference_below(int law_a, int law_b, const CellItem& item, const Cell& cell,
                                double bound);
  /// No point of region ∩ cell has every law of `laws` above its own by `bound` or more, except
  /// where its own is at y_max to within `bound`.
  bool none_above(const std::vector<int>& laws, const CellItem& item, const Cell& cell,
                  double bound);
  /// At every point of region ∩ cell some term has no law below y_max by more than `bound`.
  bool some_reach_top(const std::vector<std::vector<int>>& terms, const CellItem& item,
                      const Cell& cell, double bound);
  /// The cell holds a ball of radius 1e-9; its centre.
  bool centre(const Cell& cell, Point* centre);

  long lp_count() const { return program_.count() + ball_.count(); }

 private:
  void require_at_most(const ScaledLaw& law, double sign, double bound);
  bool reach_top_from(const std::vector<std::vector<int>>& terms, std::size_t first,
                      const CellItem& item, const Cell& cell, double bound, int* budget);

  const LawPartition& partition_;
  int dimension_;
  LinearProgram program_, ball_;
  HalfSpaces extra_;
};

}  // namespace eampc::law_design
