#include "law_design/node_grouping.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace eampc::law_design {
namespace {

// Leaf under a point that is above exactly the planes whose bits are set.
std::int32_t binary_leaf(const std::vector<BinaryNode>& nodes, std::int32_t code, unsigned above) {
  while (code >= 0) {
    const BinaryNode& node = nodes[static_cast<std::size_t>(code)];
    code = ((above >> node.plane) & 1U) != 0 ? node.above : node.below;
  }
  return code;
}

// The rule of the law file: heap order, −1 is always below.
std::int32_t grouped_leaf(const GroupedNodes& tree, unsigned above, int* nodes_met) {
  std::int32_t code = tree.root;
  for (*nodes_met = 0; code >= 0; ++*nodes_met) {
    const auto node = static_cast<std::size_t>(code);
    std::size_t place = 0;
    std::size_t path = 0;
    for (int level = 0; level < 3; ++level) {
      const std::int32_t plane = tree.node_planes[7 * node + place];
      const std::size_t bit = plane >= 0 ? (above >> plane) & 1U : 0U;
      path = 2 * path + bit;
      place = 2 * place + 1 + bit;
    }
    code = tree.node_children[8 * node + path];
  }
  return code;
}

int binary_height(const std::vector<BinaryNode>& nodes, std::int32_t code) {
  if (code < 0) return 0;
  const BinaryNode& node = nodes[static_cast<std::size_t>(code)];
  return 1 + std::max(binary_height(nodes, node.below), binary_height(nodes, node.above));
}

// Random trees of 10 planes whose subtrees are often shared; every one of the 2^10 sign patterns.
TEST(NodeGrouping, EveryPointFindsTheSameLeafInAThirdOfTheLevels) {
  constexpr int kPlanes = 10;
  std::mt19937 random(3);
  for (int round = 0; round < 200; ++round) {
    std::vector<BinaryNode> nodes;
    const int count = static_cast<int>(random() % 40);
    const auto child = [&]() -> std::int32_t {
      const bool leaf = nodes.empty() || random() % 3 == 0;
      return leaf ? ~static_cast<std::int32_t>(random() % 12)
                  : static_cast<std::int32_t>(random() % nodes.size());
    };
    for (int i = 0; i < count; ++i) {
      const auto plane = static_cast<std::int32_t>(random() % kPlanes);
      const std::int32_t below = child();
      const std::int32_t above = child();
      nodes.push_back({plane, below, above});
    }
    const std::int32_t root = nodes.empty() ? ~4 : static_cast<std::int32_t>(nodes.size()) - 1;
    const GroupedNodes grouped = group_nodes(nodes, root);
    EXPECT_EQ(grouped.depth, (binary_height(nodes, root) + 2) / 3);
    EXPECT_LE(grouped.node_planes.size() / 7, nodes.size());
    for (unsigned above = 0; above < 1U << kPlanes; ++above) {
      int met = 0;
      ASSERT_EQ(grouped_leaf(grouped, above, &met), binary_leaf(nodes, root, above));
      ASSERT_LE(met, grouped.depth);
    }
  }
}

// Whoever walks behind an absent plane (NaN does) still comes to the leaf that is there.
TEST(NodeGrouping, BothSidesOfAnAbsentPlaneEndInTheSameLeaf) {
  const std::vector<BinaryNode> nodes = {{0, ~7, ~9}};
  const GroupedNodes grouped = group_nodes(nodes, 0);
  EXPECT_EQ(grouped.node_planes, (std::vector<std::int32_t>{0, -1, -1, -1, -1, -1, -1}));
  EXPECT_EQ(grouped.node_children, (std::vector<std::int32_t>{~7, ~7, ~7, ~7, ~9, ~9, ~9, ~9}));
  EXPECT_EQ(grouped.depth, 1);
}

TEST(NodeGrouping, ASharedSubtreeIsOneNode) {
  // Twice the same three levels under different ways: node 3 begins a group once.
  const std::vector<BinaryNode> nodes = {{0, 1, 1}, {1, 2, 2}, {2, 3, 3}, {3, ~0, ~1}};
  const GroupedNodes grouped = group_nodes(nodes, 0);
  EXPECT_EQ(grouped.node_planes.size(), 14u);
  EXPECT_EQ(grouped.depth, 2);
}

}  // namespace
}  // namespace eampc::law_design
