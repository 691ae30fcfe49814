// The law in a cell as a lattice of affine pieces, y = clip(max over terms of (min over pieces)),
// proved for every region that enters the cell (Tarela, Martínez, "Region configurations for
// realizability of lattice piecewise-linear models", Math. Comput. Modelling 30, 1999).
//
// Each region's part of the cell has a term that holds its own law and only laws that are nowhere
// below it there: on the part this term is the law. Proved besides, by linear programs: no other
// term is above it there. Parts on which the output is saturated need less: at y_max one term may
// not fall below it, at y_min none may rise above it.
#pragma once

#include <optional>
#include <vector>

#include "law_design/cell_geometry.hpp"

namespace eampc::law_design {

struct LatticeLeaf {
  std::vector<std::vector<int>> terms;  ///< laws, ascending; terms ascending
  auto operator<=>(const LatticeLeaf&) const = default;
};

/// Rows of eight pieces that an evaluation reads: eight terms side by side, their longest decides.
int lattice_rows(const LatticeLeaf& leaf);

struct LatticeLimits {
  int pieces = 24;
  int rows = 12;
  /// Difference that counts as none, of the output's range.
  double same = 1e-9;
};

class LatticeFitter {
 public:
  /// Regions of different laws overlap by the rounding of their facets; on such slivers this
  /// difference counts as none.
  static constexpr double kSameOnSliver = 1e-7;

  LatticeFitter(const LawPartition& partition, CellGeometry& geometry)
      : partition_(partition), geometry_(geometry) {}

  /// `bounds`: items with a saturated output. Nothing if the law in the cell is beyond the limits
  /// or not proved.
  std::optional<LatticeLeaf> fit(const std::vector<CellItem>& items,
                                 const std::vector<CellItem>& bounds, const Cell& cell,
                                 const LatticeLimits& limits);
  /// Hyperplanes that may help if the last fit() failed though the laws were few: a term must not
  /// rise above another part, and the law that would hold it down crosses the term's own.
  const std::vector<Hyperplane>& hints() const { return hints_; }

 private:
  enum class Kind { kLaw, kLow, kHigh };
  struct Part {
    const CellItem* item;
    Kind kind;
    int law;                                // index in laws_, or −1: a bound
    std::vector<signed char> above, below;  // per law, −1 unknown: nowhere below, nowhere above
  };
  using Terms = std::vector<std::vector<int>>;  // of indices in laws_, ascending

  void collect(const std::vector<CellItem>& items, const std::vector<CellItem>& bounds);
  bool nowhere_below(Part& part, int law, const Cell& cell);
  bool nowhere_above(Part& part, int law, const Cell& cell);
  bool serves(const std::vector<int>& term, Part& part, const Cell& cell);
  bool none_above(const std::vector<int>& term, Part& part, const Cell& cell);
  bool find_terms(const Cell& cell, Terms& terms);
  void hint_at(const std::vector<int>& term, const Part& above);
  void drop_spare_laws(Terms& terms, const Cell& cell);
  bool proved_on_sliver(const Terms& terms, const CellItem& item, const Cell& cell);

  const LawPartition& partition_;
  CellGeometry& geometry_;
  double same_ = 0.0;
  std::vector<int> laws_;
  std::vector<Part> parts_;
  std::vector<Hyperplane> hints_;
};

}  // namespace eampc::law_design
