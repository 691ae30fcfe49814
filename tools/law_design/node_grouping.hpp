// Three levels of a binary tree in one node: seven hyperplanes compared at once, eight ways out.
// The grouped tree has ⌈levels / 3⌉ nodes on its longest path, and shares what the binary one
// shares.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace eampc::law_design {

/// A code ≥ 0 is a node, a code < 0 is a leaf and stays as it is.
struct BinaryNode {
  std::int32_t plane;
  std::int32_t below;
  std::int32_t above;
};

/// As in service::LawTables.
struct GroupedNodes {
  std::vector<std::int32_t> node_planes;    ///< n×7, heap order, −1 where the binary tree ends
  std::vector<std::int32_t> node_children;  ///< n×8; behind a −1 the same leaf on either side
  std::int32_t root = -1;
  int depth = 0;
};

/// Groups what can be reached from `root`. The binary nodes may share subtrees, not form circles.
GroupedNodes group_nodes(std::span<const BinaryNode> nodes, std::int32_t root);

}  // namespace eampc::law_design
