// A binary search tree over the partition of a law: each node compares normal·p with its offset,
// each leaf names one affine piece. What the tree builder makes and checks; the law file groups
// three levels into one node (node_grouping.hpp).
#pragma once

#include <cstdint>
#include <span>

#include "control/point_location.hpp"

namespace eampc::law_design {

/// normal·p ≤ offset leads to `below`, else (and for NaN) to `above`.
/// A child ≥ 0 is a node, a child < 0 is the piece ~child. Unused entries of `normal` are 0.
struct SplitNode {
  double normal[control::kMaxParameters];
  double offset;
  std::int32_t below;
  std::int32_t above;
};

/// u = gain·p + offset. Unused entries of `gain` are 0.
struct AffinePiece {
  double gain[control::kMaxParameters];
  double offset;
};

struct BinaryTree {
  std::span<const SplitNode> nodes;
  std::span<const AffinePiece> pieces;
  int n_parameters;
  int depth;          ///< most nodes on a path from the root to a leaf
  std::int32_t root;  ///< a child as in SplitNode
};

/// Value at p[0 .. n_parameters), not clipped; piece −1 and NaN if no leaf came within `depth`.
control::LawValue evaluate(const BinaryTree& tree, const double* p) noexcept;

}  // namespace eampc::law_design
