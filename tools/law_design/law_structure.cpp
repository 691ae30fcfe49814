#include "law_design/law_structure.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

#include "law_design/cell_tree.hpp"
#include "law_design/law_partition.hpp"
#include "law_design/law_symmetry.hpp"
#include "law_design/node_grouping.hpp"

namespace eampc::law_design {
namespace {

using service::LawTables;

constexpr std::size_t kFlatPlanes = 64;
// A law of this many pieces or fewer may be one lattice.
constexpr int kMostPieces = 64;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

// The parameters that an evaluator is built over: all, or those above a fold.
struct Ground {
  LawPartition partition;
  std::optional<Hyperplane> fold;
};

// Pieces, hyperplanes and leaves; how they hang together comes after.
LawTables tables_of(const CellTree& tree, const Ground& ground) {
  const LawPartition& partition = ground.partition;
  LawTables tables;
  const Eigen::Index np = partition.parameters;
  tables.n_parameters = partition.parameters;
  const Eigen::VectorXd fold =
      ground.fold ? fold_in_problem_units(*ground.fold, partition) : Eigen::VectorXd::Zero(np);
  tables.fold.assign(fold.data(), fold.data() + np);
  for (const Hyperplane& plane : tree.planes) {
    const Eigen::VectorXd row = in_problem_units(plane, partition);
    tables.hyperplanes.insert(tables.hyperplanes.end(), row.data(), row.data() + row.size());
  }
  std::map<int, std::int32_t> piece_of_law;
  tables.leaf_first.push_back(0);
  tables.term_first.push_back(0);
  for (const LatticeLeaf& leaf : tree.leaves) {
    for (const std::vector<int>& term : leaf.terms) {
      for (const int law : term) {
        const auto [entry, is_new] =
            piece_of_law.try_emplace(law, static_cast<std::int32_t>(piece_of_law.size()));
        if (is_new) {
          const Eigen::VectorXd piece = in_problem_units(partition.laws[index(law)], partition);
          tables.piece_gain.insert(tables.piece_gain.end(), piece.data(), piece.data() + np);
          tables.piece_offset.push_back(piece(np));
        }
        tables.term_pieces.push_back(entry->second);
      }
      tables.term_first.push_back(static_cast<std::int32_t>(tables.term_pieces.size()));
    }
    tables.leaf_first.push_back(static_cast<std::int32_t>(tables.term_first.size() - 1));
  }
  return tables;
}

LawTables as_tree(LawTables tables, const CellTree& tree) {
  std::vector<BinaryNode> nodes;
  for (const CellTree::Node& node : tree.nodes)
    nodes.push_back({node.plane, node.below, node.above});
  GroupedNodes grouped = group_nodes(nodes, tree.root);
  tables.node_planes = std::move(grouped.node_planes);
  tables.node_children = std::move(grouped.node_children);
  tables.root = grouped.root;
  tables.depth = grouped.depth;
  return tables;
}

// Every path of the tree as the bits it asks for.
LawTables as_flat(const LawTables& all, const CellTree& tree) {
  LawTables flat;
  flat.n_parameters = all.n_parameters;
  flat.flat = true;
  flat.piece_gain = all.piece_gain;
  flat.piece_offset = all.piece_offset;
  flat.hyperplanes = all.hyperplanes;
  flat.fold = all.fold;
  flat.leaf_first.push_back(0);
  flat.term_first.push_back(0);
  const auto walk = [&](auto&& self, std::int32_t code, std::uint64_t care,
                        std::uint64_t bits) -> void {
    if (code >= 0) {
      const CellTree::Node& node = tree.nodes[static_cast<std::size_t>(code)];
      const std::uint64_t plane = std::uint64_t{1} << node.plane;
      self(self, node.below, care | plane, bits);
      self(self, node.above, care | plane, bits | plane);
      return;
    }
    flat.leaf_care.push_back(care);
    flat.leaf_bits.push_back(bits);
    const auto leaf = static_cast<std::size_t>(~code);
    for (auto term = static_cast<std::size_t>(all.leaf_first[leaf]);
         term < static_cast<std::size_t>(all.leaf_first[leaf + 1]); ++term) {
      flat.term_pieces.insert(flat.term_pieces.end(),
                              all.term_pieces.begin() + all.term_first[term],
                              all.term_pieces.begin() + all.term_first[term + 1]);
      flat.term_first.push_back(static_cast<std::int32_t>(flat.term_pieces.size()));
    }
    flat.leaf_first.push_back(static_cast<std::int32_t>(flat.term_first.size() - 1));
  };
  walk(walk, tree.root, 0, 0);
  return flat;
}

// Time of the longest evaluation, in cycles of a current processor. Fitted to the slowest points of
// the published problems and the reference rig (`eampc bench law`, AVX-512): a node waits for the
// one before it, longer if it is not in the nearest cache; how many nodes come is guessed wrongly
// at times; hyperplanes and leaves of a flat evaluator follow each other closely; a leaf's pieces
// are gathered one by one if its terms have several.
constexpr int kFoldCycles = 10, kNodeCycles = 40, kFarNodeCycles = 55, kTreeCycles = 25;
constexpr int kFlatCycles = 40, kPlaneRowCycles = 6, kMatchRowCycles = 4;
constexpr int kRowsCycles = 35, kRowCycles = 6;
constexpr int kLatticeCycles = 75, kPieceRowCycles = 22, kIndexRowCycles = 2;
constexpr std::size_t kNearBytes = 48 << 10;

int rows_of(std::size_t count) { return static_cast<int>((count + 7) / 8); }

int leaf_cycles(const LatticeLeaf& leaf) {
  const auto one_piece = [](const std::vector<int>& term) { return term.size() == 1; };
  if (leaf.terms.size() == 1 || std::all_of(leaf.terms.begin(), leaf.terms.end(), one_piece)) {
    return kRowsCycles + kRowCycles * lattice_rows(leaf);
  }
  std::set<int> pieces;
  for (const std::vector<int>& term : leaf.terms) pieces.insert(term.begin(), term.end());
  return kLatticeCycles + kPieceRowCycles * rows_of(pieces.size()) +
         kIndexRowCycles * lattice_rows(leaf);
}

int worst_cycles(const CellTree& tree, const LawTables& tables, bool folded) {
  const int fold = folded ? kFoldCycles : 0;
  if (tables.flat || tables.root < 0) {
    int most = 0;
    for (const LatticeLeaf& leaf : tree.leaves) most = std::max(most, leaf_cycles(leaf));
    if (!tables.flat) return fold + most;
    return fold + kFlatCycles + kPlaneRowCycles * rows_of(tables.n_planes()) +
           kMatchRowCycles * rows_of(tables.n_leaves()) + most;
  }
  const std::size_t numbers = 8 * (static_cast<std::size_t>(tables.n_parameters) + 2);
  const bool near = sizeof(double) * numbers * tables.n_nodes() <= kNearBytes;
  const int node = near ? kNodeCycles : kFarNodeCycles;
  std::vector<int> known(tables.n_nodes(), -1);
  const auto walk = [&](auto&& self, std::int32_t code) -> int {
    if (code < 0) return leaf_cycles(tree.leaves[static_cast<std::size_t>(~code)]);
    int& worst = known[static_cast<std::size_t>(code)];
    if (worst < 0) {
      for (std::size_t k = 0; k < service::kChildrenPerNode; ++k) {
        const std::size_t at = static_cast<std::size_t>(code) * service::kChildrenPerNode + k;
        worst = std::max(worst, node + self(self, tables.node_children[at]));
      }
    }
    return worst;
  };
  return fold + kTreeCycles + walk(walk, tables.root);
}

int unsaturated_laws(const LawPartition& partition) {
  std::set<int> laws;
  for (const LawRegion& region : partition.regions) {
    if (!partition.is_bound(region.law)) laws.insert(region.law);
  }
  return static_cast<int>(laws.size());
}

// Small leaves are quick but many: they pay while the law stays in the near caches.
constexpr int kSmallLaw = 300, kLargeLaw = 2000;

std::vector<LatticeLimits> limits_for(const LawPartition& partition) {
  const int laws = unsaturated_laws(partition);
  std::vector<LatticeLimits> limits;
  if (laws <= kSmallLaw) {
    limits = {{8, 1}, {16, 3}, {24, 8}};
  } else {
    limits = {laws <= kLargeLaw ? LatticeLimits{24, 8} : LatticeLimits{32, 12}};
  }
  if (laws <= kMostPieces) limits.push_back({kMostPieces, kMostPieces});
  return limits;
}

// Half of the parameters if the law is odd: half the tables, at the cost of the fold. A law so
// small that this may not pay is tried both ways.
std::vector<Ground> grounds_of(LawPartition partition) {
  std::vector<Ground> grounds;
  if (const auto fold = odd_symmetry(partition)) {
    grounds.push_back({half_above(partition, *fold), fold});
    if (unsaturated_laws(partition) > kSmallLaw) return grounds;
  }
  grounds.push_back({std::move(partition), std::nullopt});
  return grounds;
}

}  // namespace

LawStructure build_law_structure(const MpQpSolution& solution, const OutputLaw& output,
                                 const LawStructureOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  if (solution.statistics.saturated_active_sets > 0) {
    throw std::invalid_argument(
        "law structure: regions with a saturated output are missing; solve without `output`");
  }
  LawPartition partition = partition_by_law(solution, output);
  LawStructure result;
  result.regions = static_cast<int>(partition.regions.size());
  result.unsaturated_regions = partition.unsaturated_regions;
  result.distinct_laws = static_cast<int>(partition.laws.size()) - 2;
  int least = std::numeric_limits<int>::max();
  for (const Ground& ground : grounds_of(std::move(partition))) {
    for (const LatticeLimits& limits : limits_for(ground.partition)) {
      CellTreeOptions cells;
      cells.limits = limits;
      cells.threads = options.threads;
      cells.progress = options.progress;
      const CellTree tree = build_cell_tree(ground.partition, cells);
      result.lps += tree.lps;
      const LawTables parts = tables_of(tree, ground);
      for (const bool flat : {false, true}) {
        if (flat && (tree.nodes.empty() || tree.planes.size() > kFlatPlanes)) continue;
        LawTables tables = flat ? as_flat(parts, tree) : as_tree(parts, tree);
        const int cycles = worst_cycles(tree, tables, ground.fold.has_value());
        if (cycles >= least) continue;
        least = cycles;
        result.tables = std::move(tables);
        result.binary_nodes = static_cast<int>(tree.nodes.size());
        result.binary_depth = tree.depth;
      }
    }
  }
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

}  // namespace eampc::law_design
