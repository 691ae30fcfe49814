#include "law_design/node_grouping.hpp"

#include <algorithm>
#include <array>
#include <cstddef>

namespace eampc::law_design {
namespace {

constexpr std::size_t kPlanes = 7;
constexpr std::size_t kChildren = 8;

class Grouping {
 public:
  explicit Grouping(std::span<const BinaryNode> nodes)
      : nodes_(nodes), grouped_(nodes.size(), -1), heights_(nodes.size(), 0) {}

  GroupedNodes run(std::int32_t root) {
    result_.root = node_of(root);
    result_.depth = height(root);
    return std::move(result_);
  }

 private:
  struct Group {
    std::array<std::int32_t, kPlanes> planes;
    std::array<std::int32_t, kChildren> ends;  // binary codes
  };

  // Heap of the three levels from `root`: below `code` at place k follow 2k+1 and 2k+2.
  Group group_at(std::int32_t root) const {
    std::array<std::int32_t, kPlanes + kChildren> heap{};
    heap[0] = root;
    Group group{};
    for (std::size_t k = 0; k < kPlanes; ++k) {
      const std::int32_t code = heap[k];
      group.planes[k] = code < 0 ? -1 : nodes_[static_cast<std::size_t>(code)].plane;
      heap[2 * k + 1] = code < 0 ? code : nodes_[static_cast<std::size_t>(code)].below;
      heap[2 * k + 2] = code < 0 ? code : nodes_[static_cast<std::size_t>(code)].above;
    }
    std::copy_n(heap.begin() + kPlanes, kChildren, group.ends.begin());
    return group;
  }

  int height(std::int32_t code) const {
    return code < 0 ? 0 : heights_[static_cast<std::size_t>(code)];
  }

  // Number of the node that begins at a binary node; recursion as deep as the grouped tree.
  std::int32_t node_of(std::int32_t code) {
    if (code < 0) return code;
    const auto at = static_cast<std::size_t>(code);
    if (grouped_[at] >= 0) return grouped_[at];
    const Group group = group_at(code);
    const std::size_t number = result_.node_planes.size() / kPlanes;
    result_.node_planes.insert(result_.node_planes.end(), group.planes.begin(), group.planes.end());
    result_.node_children.resize(result_.node_children.size() + kChildren);
    grouped_[at] = static_cast<std::int32_t>(number);
    int deepest = 0;
    for (std::size_t k = 0; k < kChildren; ++k) {
      const std::int32_t child = node_of(group.ends[k]);
      result_.node_children[number * kChildren + k] = child;
      deepest = std::max(deepest, height(group.ends[k]));
    }
    heights_[at] = deepest + 1;
    return grouped_[at];
  }

  std::span<const BinaryNode> nodes_;
  std::vector<std::int32_t> grouped_;  // per binary node, −1: none begins here
  std::vector<int> heights_;           // in grouped nodes
  GroupedNodes result_;
};

}  // namespace

GroupedNodes group_nodes(std::span<const BinaryNode> nodes, std::int32_t root) {
  return Grouping(nodes).run(root);
}

}  // namespace eampc::law_design
