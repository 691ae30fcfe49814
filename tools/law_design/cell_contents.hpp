// What a cell of the search tree holds: the regions that enter it, and how far each reaches inside.
#pragma once

#include <memory>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/linear_program.hpp"
#include "law_design/output_laws.hpp"
#include "law_design/polytope.hpp"

namespace eampc::law_design {

/// Sides of a hyperplane on which something lies, as bits.
enum : unsigned { kBelow = 1U, kAbove = 2U, kBoth = 3U };

/// Extent of region ∩ cell: a bounding box and points of it.
struct Extent {
  Point lower{}, upper{};
  std::vector<Point> points;
};

struct CellItem {
  int region = 0;
  bool thin = false;  ///< no ball of radius kThin: left out of counting, checked at the leaf
  std::shared_ptr<const Extent> extent;
};

struct Hyperplane {
  Point normal{};
  double offset = 0.0;
};

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

class CellGeometry {
 public:
  /// Regions whose part in a cell holds no ball of this radius are thin.
  static constexpr double kThin = 1e-10;
  /// A region that reaches less than this beyond a hyperplane is on one side of it.
  static constexpr double kSide = 1e-10;
  /// A cell without a ball of this radius is the rounding of two nearly equal hyperplanes.
  static constexpr double kThinCell = 1e-9;

  explicit CellGeometry(const OutputLaws& laws);

  enum class Presence { kAbsent, kThin, kThere };
  Presence presence(int region, const Cell& cell);
  std::shared_ptr<const Extent> extent(int region, const Cell& cell);

  /// False if a hyperplane surely misses the item.
  bool touches(const Hyperplane& plane, const CellItem& item) const;
  /// Sides of a hyperplane an item surely has points on (`sure`), and may have points on.
  unsigned possible_sides(const Hyperplane& plane, const CellItem& item, unsigned* sure) const;
  /// Removes from `possible` what linear programs over region ∩ cell exclude.
  unsigned proved_sides(const Hyperplane& plane, const CellItem& item, const Cell& cell,
                        unsigned possible, unsigned sure);

  /// max of law a − law b over region ∩ cell is at most `bound`.
  bool difference_below(int law_a, int law_b, const CellItem& item, const Cell& cell, double bound);

  /// The output where the line from `start` to the middle of `target` first meets one of `items`;
  /// 0.5 if it meets none.
  double first_output(const Point& start, const CellItem& target,
                      const std::vector<CellItem>& items) const;

  /// Centre of the largest ball of a cell; false if it holds none of radius kThinCell.
  bool centre(const Cell& cell, Point* centre);

  long lp_count() const { return program_.count() + ball_.count(); }

 private:
  const OutputLaws& laws_;
  int dimension_;
  LinearProgram program_, ball_;
};

}  // namespace eampc::law_design
