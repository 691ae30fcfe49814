// The tables of an explicit law as the law file holds them: distinct affine pieces and an evaluator
// whose leaves combine several of them, u = max over terms of (min over the pieces of the term).
// The design makes them, the law file carries them, law_packing turns them into what runs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace eampc::service {

/// Hyperplanes compared at one node of a tree: three levels of a binary tree.
inline constexpr int kPlanesPerNode = 7;
inline constexpr int kChildrenPerNode = 8;

struct LawTables {
  int n_parameters = 0;  ///< np
  /// False: a tree of nodes. True: all hyperplanes at once, then the first leaf that matches.
  bool flat = false;

  std::vector<double> piece_gain;    ///< n_pieces×np: u = gain·p + offset
  std::vector<double> piece_offset;  ///< n_pieces

  /// n_planes×(np+1): unit normal, offset. normal·p ≤ offset is below; above or NaN is above.
  std::vector<double> hyperplanes;

  // Tree. A code ≥ 0 is a node, a code < 0 is the leaf ~code.
  std::int32_t root = -1;
  int depth = 0;  ///< most nodes on a path
  /// n_nodes×7, heap order: below plane k follows plane 2k+1, above it 2k+2. −1: always below; the
  /// children above it are not reached, but must be codes that exist.
  std::vector<std::int32_t> node_planes;
  /// n_nodes×8, by the path's bits (above = 1), first plane most significant.
  std::vector<std::int32_t> node_children;

  // Flat: leaf k matches a mask (bit i: above plane i) if (mask & leaf_care[k]) == leaf_bits[k].
  std::vector<std::uint64_t> leaf_care, leaf_bits;

  std::vector<std::int32_t> leaf_first;   ///< n_leaves+1, into term_first
  std::vector<std::int32_t> term_first;   ///< n_terms+1, into term_pieces
  std::vector<std::int32_t> term_pieces;  ///< pieces of each term

  /// np. Zeros: none. Else u(−p) = −u(p) and only fold·p ≥ 0 is in the tables.
  std::vector<double> fold;

  std::size_t n_pieces() const { return piece_offset.size(); }
  std::size_t n_planes() const {
    return n_parameters < 0 ? 0 : hyperplanes.size() / (static_cast<std::size_t>(n_parameters) + 1);
  }
  std::size_t n_nodes() const { return node_planes.size() / kPlanesPerNode; }
  std::size_t n_leaves() const { return leaf_first.empty() ? 0 : leaf_first.size() - 1; }
  std::size_t n_terms() const { return term_first.empty() ? 0 : term_first.size() - 1; }
};

/// What is wrong with tables: the key of the law section and the rest of the sentence.
struct LawTablesDefect {
  std::string key;
  std::string what;
};

/// Checks everything an evaluation relies on: shapes, ranges, finite numbers, that every path of a
/// tree ends in a leaf after at most `depth` nodes, that leaves and terms hold something.
std::optional<LawTablesDefect> find_defect(const LawTables& tables);

}  // namespace eampc::service
