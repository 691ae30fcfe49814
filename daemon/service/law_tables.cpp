#include "service/law_tables.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <span>

#include "control/point_location.hpp"

namespace eampc::service {
namespace {

// Length of the fold's normal, largest entry: products with parameters must neither vanish nor
// overflow, or the evaluator and its proof would see different halves of the box.
constexpr double kLeastFold = 1e-100;
constexpr double kGreatestFold = 1e100;

constexpr std::size_t kMostFlatPlanes = 64;

using Defect = std::optional<LawTablesDefect>;

Defect defect(std::string key, std::string what) {
  return LawTablesDefect{std::move(key), std::move(what)};
}

bool finite(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

// first[k] .. first[k+1] cut 0 .. size into parts, none of them empty.
bool cuts(const std::vector<std::int32_t>& first, std::size_t size) {
  if (first.empty() || first.front() != 0) return false;
  if (first.back() < 0 || static_cast<std::size_t>(first.back()) != size) return false;
  return std::adjacent_find(first.begin(), first.end(),
                            [](std::int32_t a, std::int32_t b) { return a >= b; }) == first.end();
}

Defect numbers_defect(const LawTables& t) {
  if (t.n_parameters < 1 || t.n_parameters > control::kMaxParameters) {
    return defect("parameter_names",
                  "must name 1 to " + std::to_string(control::kMaxParameters) + " parameters");
  }
  const auto np = static_cast<std::size_t>(t.n_parameters);
  if (t.piece_offset.empty()) return defect("piece_gain", "holds no piece");
  if (t.piece_gain.size() != t.n_pieces() * np) {
    return defect("piece_gain", "does not have one row for each entry of piece_offset");
  }
  if (t.hyperplanes.size() % (np + 1) != 0) {
    return defect("evaluator.hyperplanes", "does not have np + 1 columns");
  }
  if (t.fold.size() != np) return defect("evaluator.fold", "does not have np numbers");
  for (const auto& [key, values] :
       {std::pair("piece_gain", &t.piece_gain), std::pair("piece_offset", &t.piece_offset),
        std::pair("evaluator.hyperplanes", &t.hyperplanes), std::pair("evaluator.fold", &t.fold)}) {
    if (!finite(*values)) return defect(key, "holds a number that is not finite");
  }
  double fold = 0.0;
  for (const double entry : t.fold) fold = std::max(fold, std::abs(entry));
  if (fold != 0.0 && (fold < kLeastFold || fold > kGreatestFold)) {
    return defect("evaluator.fold", "is neither zero nor a normal of ordinary length");
  }
  return std::nullopt;
}

// Whether the leaf holds more different pieces than can be evaluated together.
bool too_many_pieces(const LawTables& t, std::size_t leaf) {
  const auto at = [&](std::size_t k) {
    return t.term_pieces.begin() + t.term_first[static_cast<std::size_t>(t.leaf_first[k])];
  };
  if (static_cast<std::size_t>(at(leaf + 1) - at(leaf)) <= control::PackedLeaf::kMostPieces) {
    return false;
  }
  return std::set<std::int32_t>(at(leaf), at(leaf + 1)).size() > control::PackedLeaf::kMostPieces;
}

Defect leaves_defect(const LawTables& t) {
  if (t.term_first.empty() || !cuts(t.term_first, t.term_pieces.size())) {
    return defect("evaluator.term_first",
                  "does not cut term_pieces into terms of one piece or more");
  }
  if (t.n_terms() == 0 || !cuts(t.leaf_first, t.n_terms()) || t.n_leaves() == 0) {
    return defect("evaluator.leaf_first", "does not cut the terms into leaves of one term or more");
  }
  for (const std::int32_t piece : t.term_pieces) {
    if (piece < 0 || static_cast<std::size_t>(piece) >= t.n_pieces()) {
      return defect("evaluator.term_pieces", "names a piece that does not exist");
    }
  }
  for (std::size_t leaf = 0; leaf < t.n_leaves(); ++leaf) {
    if (too_many_pieces(t, leaf)) {
      return defect("evaluator.term_pieces",
                    "names more than the " + std::to_string(control::PackedLeaf::kMostPieces) +
                        " different pieces that a leaf can hold, at leaf " + std::to_string(leaf));
    }
  }
  return std::nullopt;
}

bool child_exists(const LawTables& t, std::int32_t child) {
  return child >= 0 ? static_cast<std::size_t>(child) < t.n_nodes()
                    : static_cast<std::size_t>(~child) < t.n_leaves();
}

// Most nodes on a path from the root, or −1 if a path runs in a circle. Children may be shared.
int height(const LawTables& t) {
  if (t.root < 0) return 0;
  constexpr int kUnseen = -1;
  constexpr int kOpen = -2;
  std::vector<int> known(t.n_nodes(), kUnseen);
  std::vector<std::int32_t> path{t.root};
  while (!path.empty()) {
    const auto node = static_cast<std::size_t>(path.back());
    known[node] = kOpen;
    int longest = 0;
    std::int32_t next = -1;
    for (const std::int32_t child :
         std::span(t.node_children).subspan(node * kChildrenPerNode, kChildrenPerNode)) {
      if (child < 0) continue;
      const int below = known[static_cast<std::size_t>(child)];
      if (below == kOpen) return -1;
      if (below == kUnseen) next = child;
      longest = std::max(longest, below);
    }
    if (next >= 0) {
      path.push_back(next);
    } else {
      known[node] = longest + 1;
      path.pop_back();
    }
  }
  return known[static_cast<std::size_t>(t.root)];
}

Defect tree_defect(const LawTables& t) {
  if (!t.leaf_care.empty() || !t.leaf_bits.empty()) {
    return defect("evaluator.leaf_care", "and leaf_bits belong to a flat evaluator, not to a tree");
  }
  if (t.node_planes.size() % kPlanesPerNode != 0 ||
      t.node_children.size() != t.n_nodes() * kChildrenPerNode) {
    return defect("evaluator.node_children",
                  "does not have eight codes for each row of node_planes");
  }
  for (const std::int32_t plane : t.node_planes) {
    if (plane < -1 || (plane >= 0 && static_cast<std::size_t>(plane) >= t.n_planes())) {
      return defect("evaluator.node_planes", "names a hyperplane that does not exist");
    }
  }
  for (std::size_t i = 0; i < t.node_children.size(); ++i) {
    if (!child_exists(t, t.node_children[i])) {
      return defect("evaluator.node_children",
                    "names a node or leaf that does not exist, at node " +
                        std::to_string(i / kChildrenPerNode));
    }
  }
  if (!child_exists(t, t.root)) {
    return defect("evaluator.root", "names a node or leaf that does not exist");
  }
  const int longest = height(t);
  if (longest < 0) return defect("evaluator.node_children", "runs in a circle");
  if (longest != t.depth) {
    return defect("evaluator.depth", "is " + std::to_string(t.depth) +
                                         ", but the longest path of the tree has " +
                                         std::to_string(longest) + " nodes");
  }
  return std::nullopt;
}

Defect flat_defect(const LawTables& t) {
  if (!t.node_planes.empty() || !t.node_children.empty() || t.depth != 0) {
    return defect("evaluator.node_planes", "belongs to a tree, not to a flat evaluator");
  }
  if (t.n_planes() > kMostFlatPlanes) {
    return defect(
        "evaluator.hyperplanes",
        "has more rows than the " + std::to_string(kMostFlatPlanes) + " of a flat evaluator");
  }
  if (t.leaf_care.size() != t.n_leaves() || t.leaf_bits.size() != t.n_leaves()) {
    return defect("evaluator.leaf_care", "and leaf_bits do not have one row for each leaf");
  }
  const std::uint64_t planes =
      t.n_planes() == kMostFlatPlanes ? ~std::uint64_t{0} : (std::uint64_t{1} << t.n_planes()) - 1;
  for (std::size_t k = 0; k < t.n_leaves(); ++k) {
    if ((t.leaf_care[k] & ~planes) != 0) {
      return defect("evaluator.leaf_care",
                    "names a hyperplane that does not exist, at leaf " + std::to_string(k));
    }
    if ((t.leaf_bits[k] & ~t.leaf_care[k]) != 0) {
      return defect("evaluator.leaf_bits",
                    "asks for bits outside leaf_care, at leaf " + std::to_string(k));
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<LawTablesDefect> find_defect(const LawTables& tables) {
  if (Defect found = numbers_defect(tables)) return found;
  if (Defect found = leaves_defect(tables)) return found;
  return tables.flat ? flat_defect(tables) : tree_defect(tables);
}

}  // namespace eampc::service
