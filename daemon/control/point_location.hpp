// p (the law's parameters, units of the rig) → u, not clipped, and the affine piece that gave it.
//
// An explicit law is located by comparing p with hyperplanes, normal·p ≤ offset being "below", and
// ends in a leaf that holds several affine pieces: u = max over terms of (min over its pieces).
//   tree:  a node compares 7 hyperplanes at once, three levels of a binary tree, 8 ways out
//   flat:  up to 64 hyperplanes at once → bit mask → the first leaf that matches
//   a tree without nodes is one leaf: the global lattice of the law
// Everything is computed in double, in a fixed order of summation and without fused operations, so
// that every path (scalar, 128-bit, AVX2, AVX-512) gives the same bits:
//   normal·p: products summed in adjacent pairs, level by level, an odd one carried
//   piece:    the same over (offset, gain_1 p_1, …, gain_np p_np)
// Eight hyperplanes stand side by side in memory, one per lane; unused lanes repeat. So do the
// pieces of a leaf that is a max or a min of pieces. Any other leaf names its pieces in one table
// that all leaves share and that stays in a near cache: each piece is evaluated once, then lanes
// are terms that look up their pieces' values.
// Cost bound: `depth` nodes or all hyperplanes, then one leaf (service::evaluation_cost); no other
// loop. Absent on purpose: clipping, clamping p onto the parameter box, finite checks (the caller
// does all three), allocation, any check of the tables (done when they are packed).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "control/nonblocking.hpp"

namespace eampc::control {

// e (3), u_ss, y_r and ẏ_r make 6 today; two spare.
inline constexpr int kMaxParameters = 8;
// Hyperplanes or pieces side by side: one 64-byte line of doubles.
inline constexpr std::size_t kLanes = 8;

struct LawValue {
  double u;            ///< not clipped
  std::int32_t piece;  ///< -1, with u = NaN, if p is NaN or no leaf matches
};

// A leaf of several terms of several pieces, 64-byte aligned: this, then the numbers of its pieces,
// eight per row, the last one repeated to fill the row, then every eight terms: the length of the
// longest (8 bytes), and for each place in a term eight bytes, which of the leaf's pieces stands
// there in each term. A short term repeats its last piece, the last term fills up.
struct PackedLeaf {
  static constexpr std::size_t kMostPieces = 256;
  static constexpr std::size_t kBytes = 64;  ///< the unit in which LeafCode counts

  std::uint32_t rows = 0;    ///< of eight pieces
  std::uint32_t groups = 0;  ///< of eight terms
};

// Where a leaf stands. Terms of one piece each, or one term (stored negated, min a = −max −a): its
// rows of pieces. Any other leaf has no groups and its PackedLeaf instead of rows.
struct LeafCode {
  static constexpr int kGroupBits = 4;
  static constexpr std::uint32_t kMostGroups = (1U << kGroupBits) - 1;
  static constexpr std::uint32_t kMostRows = 1U << (31 - kGroupBits - 1);

  static constexpr std::uint32_t of(std::uint32_t first_row, std::uint32_t groups, bool negated) {
    return (first_row << (kGroupBits + 1)) | (groups << 1) | (negated ? 1U : 0U);
  }
  static constexpr std::uint32_t first_row(std::uint32_t code) { return code >> (kGroupBits + 1); }
  static constexpr std::uint32_t groups(std::uint32_t code) { return (code >> 1) & kMostGroups; }
};

// A law as it runs: spans into 64-byte aligned storage owned by whoever packed it.
struct PackedLaw {
  using Function = LawValue (*)(const PackedLaw& law, const double* p) noexcept EAMPC_NONBLOCKING;

  Function function = nullptr;  ///< chosen once, by np, shape and processor
  int n_parameters = 0;
  int depth = 0;          ///< most nodes on a path
  std::int32_t root = 0;  ///< a child as below
  int most_groups = 0;    ///< rows of the largest leaf that is a max or a min
  /// Nodes of (np+2)·64 bytes: np rows of eight normals, eight offsets, eight children (int32). A
  /// child ≥ 0 is the byte at which a node begins, a child < 0 is a leaf: ~child is its LeafCode.
  std::span<const std::byte> nodes;
  /// Flat: rows of eight hyperplanes, np normals and an offset each.
  std::span<const double> planes;
  /// Flat: per eight leaves eight `care`, eight `bits`; and per leaf a code as ~child.
  std::span<const std::uint64_t> matches;
  std::span<const std::uint32_t> flat_leaves;
  /// Rows of eight pieces: eight offsets, np rows of eight gains; and their numbers.
  std::span<const double> rows;
  std::span<const std::int32_t> row_pieces;
  /// Only if some leaf has several terms of several pieces: PackedLeaf, and every piece as offset,
  /// gains, and −0 up to piece_stride numbers.
  std::span<const std::byte> leaves;
  std::span<const double> pieces;
  /// Empty, or np numbers: where fold·p < 0 the law is −law(−p).
  std::span<const double> fold;
};

/// u and piece at p[0 .. n_parameters). Noexcept, no allocation, no branch on the path taken.
inline LawValue evaluate(const PackedLaw& law, const double* p) noexcept {
  return law.function(law, p);
}

enum class EvaluationPath : std::uint8_t { kBest, kScalar, kVector128, kAvx2, kAvx512 };

/// Numbers from one piece to the next in PackedLaw::pieces: whole 64-byte lines.
constexpr std::size_t piece_stride(std::size_t n_parameters) {
  return (n_parameters + kLanes) / kLanes * kLanes;
}

struct LawShape {
  bool flat = false;
  bool general_leaves = false;
};

/// The evaluation for np parameters; nullptr if this machine or np cannot have it.
PackedLaw::Function evaluation(int n_parameters, LawShape shape, EvaluationPath path) noexcept;

}  // namespace eampc::control
