#include "service/law_cost.hpp"

#include <algorithm>
#include <vector>

#include "control/point_location.hpp"

namespace eampc::service {
namespace {

constexpr auto kLanes = static_cast<std::int64_t>(control::kLanes);

std::int64_t padded(std::int64_t count) { return (count + kLanes - 1) / kLanes * kLanes; }

// Costliest way from each node to the end of a leaf: children before parents.
std::int64_t tree_cost(const LawTables& t, std::int64_t node_cost) {
  if (t.root < 0) return leaf_cost(t, static_cast<std::size_t>(~t.root));
  std::vector<std::int64_t> leaf(t.n_leaves());
  for (std::size_t k = 0; k < leaf.size(); ++k) leaf[k] = leaf_cost(t, k);
  std::vector<std::int64_t> known(t.n_nodes(), -1);
  std::vector<std::int32_t> path{t.root};
  while (!path.empty()) {
    const auto node = static_cast<std::size_t>(path.back());
    std::int64_t most = 0;
    std::int32_t next = -1;
    for (std::size_t k = 0; k < kChildrenPerNode; ++k) {
      const std::int32_t child = t.node_children[node * kChildrenPerNode + k];
      if (child < 0) {
        most = std::max(most, leaf[static_cast<std::size_t>(~child)]);
      } else if (known[static_cast<std::size_t>(child)] < 0) {
        next = child;
      } else {
        most = std::max(most, known[static_cast<std::size_t>(child)]);
      }
    }
    if (next >= 0) {
      path.push_back(next);
    } else {
      known[node] = most + node_cost;
      path.pop_back();
    }
  }
  return known[static_cast<std::size_t>(t.root)];
}

}  // namespace

// As packed.
std::int64_t leaf_cost(const LawTables& t, std::size_t leaf) {
  const std::int64_t piece = 2 * std::int64_t{t.n_parameters} + 1;
  const std::int32_t first = t.leaf_first[leaf];
  const std::int32_t last = t.leaf_first[leaf + 1];
  const auto begin = t.term_pieces.begin() + t.term_first[static_cast<std::size_t>(first)];
  const auto end = t.term_pieces.begin() + t.term_first[static_cast<std::size_t>(last)];
  const std::int64_t named = end - begin;
  const std::int64_t terms = last - first;
  constexpr std::int64_t kMostOfRows = control::LeafCode::kMostGroups * kLanes;
  if ((terms == 1 || terms == named) && named <= kMostOfRows) return padded(named) * piece;
  std::vector<std::int32_t> pieces(begin, end);
  std::sort(pieces.begin(), pieces.end());
  pieces.erase(std::unique(pieces.begin(), pieces.end()), pieces.end());
  std::vector<std::int64_t> lengths;
  for (auto term = static_cast<std::size_t>(first); term < static_cast<std::size_t>(last); ++term) {
    lengths.push_back(t.term_first[term + 1] - t.term_first[term]);
  }
  std::sort(lengths.rbegin(), lengths.rend());
  const std::int64_t line = std::max<std::int64_t>(kLanes, t.n_parameters + 1);
  std::int64_t lattice = padded(static_cast<std::int64_t>(pieces.size())) * 2 * line;
  for (std::size_t k = 0; k < lengths.size(); k += control::kLanes) lattice += kLanes * lengths[k];
  return std::max(lattice, named * piece);
}

std::int64_t evaluation_cost(const LawTables& t) {
  const std::int64_t np = t.n_parameters;
  const std::int64_t plane = 2 * np;
  const bool folds = std::any_of(t.fold.begin(), t.fold.end(), [](double f) { return f != 0.0; });
  const std::int64_t fold = folds ? 3 * np + 1 : 0;
  if (!t.flat) return fold + tree_cost(t, kLanes * plane + 1);
  std::int64_t most = 0;
  for (std::size_t k = 0; k < t.n_leaves(); ++k) most = std::max(most, leaf_cost(t, k));
  const auto planes = static_cast<std::int64_t>(t.n_planes());
  const auto leaves = static_cast<std::int64_t>(t.n_leaves());
  return fold + padded(planes) * plane + 2 * padded(leaves) + most;
}

}  // namespace eampc::service
