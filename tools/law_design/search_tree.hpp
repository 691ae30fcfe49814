// Binary search tree over an explicit law y = clip(piece(p), y_min, y_max), each leaf proved.
//
// Only regions with an unsaturated output are sorted into the tree. That is enough: y is
// continuous on the convex set of feasible parameters, so
//  - in a cell (convex) that no unsaturated region enters, y is y_min throughout or y_max
//    throughout, and one point tells which;
//  - in a cell that only regions of one law L enter, those regions fill the whole of
//    {y_min < L < y_max} within the cell (each facet they have in there leads to another such
//    region), and on either side of it y is constant and, by continuity, the bound that L has
//    passed: y = clip(L) in the whole cell, saturated regions included.
// This rests on every unsaturated region being known; see MpQpOptions::output.
#pragma once

#include <functional>
#include <vector>

#include "law_design/binary_tree.hpp"
#include "law_design/mpqp.hpp"

namespace eampc::law_design {

struct SearchTreeStatistics {
  int unsaturated_regions = 0;
  int distinct_laws = 0;
  int nodes = 0;
  int leaves = 0;
  int pieces = 0;
  int depth = 0;
  long lps = 0;
  /// Leaves that accepted slivers of other laws.
  int sliver_leaves = 0;
  /// Leaves in which no feasible parameter was found; they name the nearest law.
  int infeasible_leaves = 0;
  double seconds = 0.0;
};

struct BuiltSearchTree {
  std::vector<SplitNode> nodes;
  std::vector<AffinePiece> pieces;
  int n_parameters = 0;
  int depth = 0;
  std::int32_t root = 0;
  SearchTreeStatistics statistics;

  /// For evaluate(); valid as long as this object.
  BinaryTree view() const { return {nodes, pieces, n_parameters, depth, root}; }
};

struct SearchTreeOptions {
  /// Called now and then with (nodes made, regions still in the current node); false cancels.
  std::function<bool(int, int)> progress;
  int max_nodes = 1000000;
  /// Regions of different laws overlap by the rounding of their facets. Where no facet separates
  /// such a sliver from a cell, the cell's law is accepted if it is proved to differ by no more
  /// than this (of the output's range); where facets do separate, 1e-9 is the limit.
  double accepted_difference = 1e-7;
};

/// Builds the tree. Throws std::runtime_error if a leaf cannot be proved, Cancelled.
BuiltSearchTree build_search_tree(const MpQpSolution& solution, const OutputLaw& output,
                                  const SearchTreeOptions& options = {});

}  // namespace eampc::law_design
