// A binary tree of hyperplanes over the partition of a law, each leaf a proved lattice.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "law_design/lattice_leaf.hpp"
#include "law_design/law_partition.hpp"

namespace eampc::law_design {

struct CellTree {
  struct Node {
    int plane = 0;
    /// A code ≥ 0 is a node, a code < 0 is the leaf ~code.
    std::int32_t below = 0, above = 0;
  };
  std::vector<Node> nodes;
  std::vector<Hyperplane> planes;  ///< scaled, each once
  std::vector<LatticeLeaf> leaves;
  std::int32_t root = -1;
  int depth = 0;
  long lps = 0;
};

struct CellTreeOptions {
  LatticeLimits limits;
  int threads = 0;  ///< 0: one per core. The tree does not depend on it.
  long max_nodes = 4'000'000;
  /// Called now and then with (nodes made, 0); false cancels.
  std::function<bool(long, long)> progress;
};

/// Throws std::runtime_error if a cell cannot be proved, Cancelled.
CellTree build_cell_tree(const LawPartition& partition, const CellTreeOptions& options);

}  // namespace eampc::law_design
