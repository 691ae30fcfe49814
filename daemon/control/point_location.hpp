// p (the law's parameters, units of the rig) → u (V) and the affine piece that gave it.
//
// Binary search tree over the partition of an explicit law: each node compares normal·p with its
// offset, each leaf names one affine piece u = gain·p + offset.
// Cost bound: `depth` products of kMaxParameters numbers and one piece; no other loop.
// Absent on purpose: clipping, clamping p onto the parameter box and finite checks (the caller
// does all three), loading, validation of the arrays (done when the law file is read).
#pragma once

#include <cstdint>
#include <span>

namespace eampc::control {

// e (3), u_ss, y_r and ẏ_r make 6 today; two spare keep a node at 80 bytes.
inline constexpr int kMaxParameters = 8;

/// normal·p ≤ offset leads to `below`, else (and for NaN) to `above`.
/// A child ≥ 0 is a node, a child < 0 is the piece ~child. Unused entries of `normal` are 0.
struct SplitNode {
  double normal[kMaxParameters];
  double offset;
  std::int32_t below;
  std::int32_t above;
};

/// u = gain·p + offset. Unused entries of `gain` are 0.
struct AffinePiece {
  double gain[kMaxParameters];
  double offset;
};

struct SearchTree {
  std::span<const SplitNode> nodes;
  std::span<const AffinePiece> pieces;
  int n_parameters;
  int depth;          ///< most nodes on a path from the root to a leaf
  std::int32_t root;  ///< a child as in SplitNode
};

struct LawValue {
  double u;            ///< not clipped
  std::int32_t piece;  ///< -1, with u = NaN, if no leaf came within `depth` (a malformed tree)
};

/// Evaluates the law at p[0 .. n_parameters).
LawValue evaluate(const SearchTree& tree, const double* p) noexcept;

}  // namespace eampc::control
