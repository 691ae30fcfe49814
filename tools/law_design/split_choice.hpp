// Which hyperplane divides a cell best: the one whose larger side keeps the fewest laws.
//
// Judged by the points known of each region's part, so a region may be counted on too few sides;
// the division itself is exact.
#pragma once

#include <vector>

#include "law_design/cell_geometry.hpp"

namespace eampc::law_design {

struct RankedSplit {
  Hyperplane plane;
  double cost = 0.0;
};

class SplitChoice {
 public:
  explicit SplitChoice(const LawPartition& partition);

  /// Splits of a cell, best first, among them those of `hints`. `all`: every hyperplane there is,
  /// not a selection.
  std::vector<RankedSplit> rank(const std::vector<CellItem>& items,
                                const std::vector<Hyperplane>& hints, bool all);

 private:
  double cost(const Hyperplane& plane, const std::vector<CellItem>& items);
  void facets(const std::vector<CellItem>& items, std::size_t most);
  void law_differences(const std::vector<CellItem>& items, std::size_t most);
  void medians(const std::vector<CellItem>& items);

  const LawPartition& partition_;
  std::vector<Hyperplane> candidates_;
  std::vector<int> stamp_plane_, stamp_law_;
  std::vector<unsigned char> sides_of_law_;
  int stamp_ = 0;
};

}  // namespace eampc::law_design
