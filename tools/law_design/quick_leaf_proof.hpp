// The proof of leaf_proof.hpp with few linear programs. Sufficient for "not too high" is one piece
// of the term that is nowhere above the region's law, for "not too low" one term whose pieces are
// nowhere below it: comparisons of two affine functions. Each is asked first of points known to lie
// in the cell (which can only refute), then once of the whole region, which answers for all cells
// that the region enters, and only then of the cell. What is left goes to LeafProof. Nothing rests
// on the points: they choose what to ask.
#pragma once

#include <vector>

#include "law_design/double_arena.hpp"
#include "law_design/leaf_proof.hpp"

namespace eampc::law_design {

class QuickLeafProof {
 public:
  QuickLeafProof(const service::LawTables& tables, const std::vector<AffineForm>& pieces,
                 DoubleArena& arena, double tolerance);

  /// A region (arena.facets), its law, the law's range and a box on it; points of the region.
  void start(const AffineForm& own, double low, double high, const Point& lower, const Point& upper,
             const std::vector<Point>& points);
  /// True if proved on arena.facets ∩ arena.cell, of which some points are known.
  bool prove(int leaf, const std::vector<Point>& points);

 private:
  enum class Known : signed char { kNothing, kNo, kYes };
  enum Side { kAbove = 0, kBelow = 1 };
  /// What is known of a piece: nowhere above, nowhere below the law, by more than the tolerance.
  struct Comparison {
    unsigned region = 0, cell = 0;  ///< in which the following was found
    Known in_region[2] = {}, in_cell[2] = {};
    std::size_t seen = 0;            ///< points compared
    double most[2] = {}, sum = 0.0;  ///< of the difference there
  };

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  Comparison& look(int piece);
  bool refuted(int piece, Side side) { return look(piece).most[side] > tolerance_; }
  AffineForm difference(int piece, Side side) const;
  double value(const AffineForm& form, const Point& q) const;
  bool holds_in_region(int piece, Side side);
  bool holds_in_cell(int piece, Side side);
  bool not_too_high(int term);
  bool not_too_low(int leaf);

  const service::LawTables& tables_;
  const std::vector<AffineForm>& pieces_;
  DoubleArena& arena_;
  LeafProof<DoubleArena> proof_;
  double tolerance_;
  std::size_t np_;
  AffineForm own_{}, target_{};
  double low_ = 0.0, high_ = 0.0;
  Point lower_{}, upper_{};
  unsigned region_ = 0, cell_ = 0;
  std::vector<Comparison> known_;
  std::vector<Point> region_points_, points_;
  std::vector<int> candidates_;
};

}  // namespace eampc::law_design
