#include "law_design/search_tree_tables.hpp"

#include <algorithm>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>

#include "law_design/node_grouping.hpp"

namespace eampc::law_design {

service::LawTables law_tables(const BuiltSearchTree& tree) {
  service::LawTables tables;
  const auto np = static_cast<std::size_t>(tree.n_parameters);
  tables.n_parameters = tree.n_parameters;
  for (const AffinePiece& piece : tree.pieces) {
    tables.piece_gain.insert(tables.piece_gain.end(), piece.gain, piece.gain + np);
    tables.piece_offset.push_back(piece.offset);
  }
  // A hyperplane divides many cells: the tables hold it once, in ascending order.
  std::map<std::vector<double>, std::int32_t> planes;
  const auto plane_of = [np](const SplitNode& node) {
    std::vector<double> plane(node.normal, node.normal + np);
    plane.push_back(node.offset);
    return plane;
  };
  for (const SplitNode& node : tree.nodes) planes.try_emplace(plane_of(node), 0);
  for (auto& [plane, number] : planes) {
    number = static_cast<std::int32_t>(tables.n_planes());
    tables.hyperplanes.insert(tables.hyperplanes.end(), plane.begin(), plane.end());
  }
  std::vector<BinaryNode> nodes;
  for (const SplitNode& node : tree.nodes) {
    nodes.push_back({planes.at(plane_of(node)), node.below, node.above});
  }
  GroupedNodes grouped = group_nodes(nodes, tree.root);
  tables.node_planes = std::move(grouped.node_planes);
  tables.node_children = std::move(grouped.node_children);
  tables.root = grouped.root;
  tables.depth = grouped.depth;
  tables.leaf_first.resize(tree.pieces.size() + 1);
  std::iota(tables.leaf_first.begin(), tables.leaf_first.end(), 0);
  tables.term_first = tables.leaf_first;
  tables.term_pieces.assign(tables.leaf_first.begin(), tables.leaf_first.end() - 1);
  tables.fold.assign(np, 0.0);
  return tables;
}

}  // namespace eampc::law_design
