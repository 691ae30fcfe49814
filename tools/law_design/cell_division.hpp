// A cell divided by a hyperplane, one region's part at a time.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "law_design/cell_geometry.hpp"

namespace eampc::law_design {

/// Points of a part that are kept.
inline constexpr std::size_t kMostPoints = 16;

/// What of an item lies below (0) and above (1) a hyperplane; or it is there as a whole, unchanged.
struct DividedItem {
  enum class Whole : unsigned char { kNeither, kBelow, kAbove } whole = Whole::kNeither;
  std::optional<CellItem> parts[2];
};

/// One for each thread: results do not depend on what was divided before.
class CellDivision {
 public:
  explicit CellDivision(const LawPartition& partition);

  /// The cell and the hyperplane for divide().
  void enter(const Cell& cell, const Hyperplane& plane);
  /// With `measure` the extents of what is divided are found anew.
  DividedItem divide(const CellItem& item, bool measure);
  CellGeometry& geometry() { return geometry_; }

 private:
  bool other_side(const CellItem& item, bool above, CellItem& part);

  int parameters_;
  CellGeometry geometry_;
  Hyperplane plane_;
  std::array<Cell, 2> sides_;
};

}  // namespace eampc::law_design
