#include "law_design/law_structure.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <map>
#include <stdexcept>
#include <utility>
#include <vector>

#include "law_design/cell_tree.hpp"
#include "law_design/law_partition.hpp"
#include "law_design/node_grouping.hpp"

namespace eampc::law_design {
namespace {

using service::LawTables;

constexpr std::size_t kFlatPlanes = 64;
// A law of this many pieces or fewer may be one lattice.
constexpr int kMostPieces = 64;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

// Pieces, hyperplanes and leaves; how they hang together comes after.
LawTables tables_of(const CellTree& tree, const LawPartition& partition) {
  LawTables tables;
  const Eigen::Index np = partition.parameters;
  tables.n_parameters = partition.parameters;
  tables.fold.assign(static_cast<std::size_t>(np), 0.0);
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

// Time of the longest evaluation, in cycles of a current processor with warm caches: a node waits
// for the one before it, rows follow each other closely. Measured with `eampc bench law`.
constexpr int kNodeCycles = 40, kRowCycles = 12, kPlaneRowCycles = 10;

int worst_cycles(const CellTree& tree, const LawTables& tables) {
  const auto leaf = [&](std::size_t k) { return kRowCycles * lattice_rows(tree.leaves[k]); };
  if (tables.flat) {
    int most = 0;
    for (std::size_t k = 0; k < tree.leaves.size(); ++k) most = std::max(most, leaf(k));
    const auto rows = [](std::size_t count) { return static_cast<int>((count + 7) / 8); };
    return most + kPlaneRowCycles * rows(tables.n_planes()) + 2 * rows(tables.n_leaves());
  }
  std::vector<int> known(tables.n_nodes(), -1);
  const auto walk = [&](auto&& self, std::int32_t code) -> int {
    if (code < 0) return leaf(static_cast<std::size_t>(~code));
    int& worst = known[static_cast<std::size_t>(code)];
    if (worst < 0) {
      for (std::size_t k = 0; k < service::kChildrenPerNode; ++k) {
        const std::size_t at = static_cast<std::size_t>(code) * service::kChildrenPerNode + k;
        worst = std::max(worst, kNodeCycles + self(self, tables.node_children[at]));
      }
    }
    return worst;
  };
  return walk(walk, tables.root);
}

// Leaves of few rows are quick but many: only for laws small enough to be held in the nearest
// caches all the same.
constexpr int kSmallLaw = 600;

std::vector<LatticeLimits> limits_for(const LawPartition& partition) {
  const int laws = static_cast<int>(partition.laws.size()) - 2;
  std::vector<LatticeLimits> limits;
  if (laws <= kSmallLaw) {
    limits.push_back({16, 3});
    limits.push_back({24, 8});
  } else {
    limits.push_back({32, 12});
  }
  if (laws <= kMostPieces) limits.push_back({kMostPieces, kMostPieces});
  return limits;
}

}  // namespace

LawStructure build_law_structure(const MpQpSolution& solution, const OutputLaw& output,
                                 const LawStructureOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  if (solution.statistics.saturated_active_sets > 0) {
    throw std::invalid_argument(
        "law structure: regions with a saturated output are missing; solve without `output`");
  }
  const LawPartition partition = partition_by_law(solution, output);
  LawStructure result;
  result.regions = static_cast<int>(partition.regions.size());
  result.unsaturated_regions = partition.unsaturated_regions;
  result.distinct_laws = static_cast<int>(partition.laws.size()) - 2;
  int least = 0;
  for (const LatticeLimits& limits : limits_for(partition)) {
    CellTreeOptions cells;
    cells.limits = limits;
    cells.threads = options.threads;
    cells.progress = options.progress;
    const CellTree tree = build_cell_tree(partition, cells);
    result.lps += tree.lps;
    const LawTables parts = tables_of(tree, partition);
    for (const bool flat : {false, true}) {
      if (flat && (tree.nodes.empty() || tree.planes.size() > kFlatPlanes)) continue;
      LawTables tables = flat ? as_flat(parts, tree) : as_tree(parts, tree);
      const int cycles = worst_cycles(tree, tables);
      if (result.tables.n_parameters > 0 && cycles >= least) continue;
      least = cycles;
      result.tables = std::move(tables);
      result.binary_nodes = static_cast<int>(tree.nodes.size());
      result.binary_depth = tree.depth;
    }
  }
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

}  // namespace eampc::law_design
