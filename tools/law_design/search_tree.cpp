#include "law_design/search_tree.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "law_design/cell_contents.hpp"
#include "law_design/law_planes.hpp"
#include "law_design/output_laws.hpp"

namespace eampc::law_design {
namespace {

// Slivers of other laws a leaf may contain, of the output's range.
constexpr double kAcceptedDifference = 1e-9;
// A split is chosen among at most this many hyperplanes, evenly taken from all of the cell's.
constexpr std::size_t kMostCandidates = 300;
// Cells with at most this many regions are scored by exact sides within the cell.
constexpr std::size_t kExactScoring = 400;
// Cost of a child with n laws is n^kBalance. Measured on laws of 4 to 6 parameters: from 1.2 to 4
// the depth falls threefold and more at about the same number of nodes, then nodes grow.
constexpr double kBalance = 4.0;
constexpr int kMostDepth = 200;
constexpr std::size_t kSideCacheBytes = 300'000'000;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

struct Split {
  int plane;
  double cost;
};

class TreeBuilder {
 public:
  TreeBuilder(OutputLaws laws, const OutputLaw& output, const SearchTreeOptions& options,
              bool everywhere_feasible);
  BuiltSearchTree run();

 private:
  struct Child {
    std::int32_t code = 0;
    int depth = 0;
  };
  using Items = std::vector<CellItem>;

  unsigned sides_of_region(int plane, int region);
  Child build(Items items, int depth);
  bool accept_as_leaf(const Items& items, int law, double difference);
  void promote_thin(Items& items);
  std::vector<Split> rank_splits(const Items& items, bool all_facets);
  double cost_of(int plane, const Items& items);
  bool divide(const Items& items, int plane, Items& below, Items& above);
  int bound_in_cell(const Items& around, const Point& start);
  Child leaf(int law);
  std::int32_t node_of(int plane, std::int32_t below, std::int32_t above);
  void check_insides(const BuiltSearchTree& tree) const;

  OutputLaws laws_;
  OutputLaw output_;
  const SearchTreeOptions& options_;
  bool everywhere_feasible_;
  CellGeometry geometry_;
  Cell cell_;
  Cell whole_;
  std::vector<Hyperplane> planes_;
  std::vector<std::vector<int>> law_planes_, outer_planes_;  // per region
  std::vector<char> in_use_;                                 // planes that bound the cell
  std::vector<std::vector<unsigned char>> sides_;            // per plane and region, 0 unknown
  std::size_t side_bytes_ = 0;
  std::vector<int> stamp_plane_, stamp_law_;
  std::vector<unsigned> law_sides_;
  int stamp_ = 0;
  int low_law_ = 0, high_law_ = 0;
  std::vector<std::int32_t> piece_of_law_;
  std::map<std::array<std::int32_t, 3>, std::int32_t> node_codes_;  // (plane, below, above)
  BuiltSearchTree tree_;
};

TreeBuilder::TreeBuilder(OutputLaws laws, const OutputLaw& output, const SearchTreeOptions& options,
                         bool everywhere_feasible)
    : laws_(std::move(laws)),
      output_(output),
      options_(options),
      everywhere_feasible_(everywhere_feasible),
      geometry_(laws_),
      cell_(laws_.parameters),
      whole_(laws_.parameters) {
  tree_.statistics.distinct_laws = static_cast<int>(laws_.laws.size());
  tree_.statistics.unsaturated_regions = static_cast<int>(laws_.regions.size());
  low_law_ = static_cast<int>(laws_.laws.size());
  high_law_ = low_law_ + 1;
  laws_.laws.push_back(ScaledLaw{});
  laws_.laws.push_back(ScaledLaw{});
  laws_.laws.back()[kMaxDimension] = 1.0;
  piece_of_law_.assign(laws_.laws.size(), -1);
  law_sides_.assign(laws_.laws.size(), 0U);
  stamp_law_.assign(laws_.laws.size(), -1);
  LawPlanes shared = collect_law_planes(laws_);
  planes_ = std::move(shared.planes);
  law_planes_ = std::move(shared.law);
  outer_planes_ = std::move(shared.outer);
  in_use_.assign(planes_.size(), 0);
  sides_.resize(planes_.size());
  stamp_plane_.assign(planes_.size(), -1);
}

unsigned TreeBuilder::sides_of_region(int plane, int region) {
  std::vector<unsigned char>& row = sides_[index(plane)];
  if (row.empty() && side_bytes_ < kSideCacheBytes) {
    row.assign(laws_.regions.size(), 0);
    side_bytes_ += row.size();
  }
  if (!row.empty() && row[index(region)] != 0) return row[index(region)];
  CellItem item;
  item.region = region;
  const unsigned result = geometry_.proved_sides(planes_[index(plane)], item, whole_, kBoth, 0U);
  if (!row.empty()) row[index(region)] = static_cast<unsigned char>(result);
  return result;
}

double TreeBuilder::cost_of(int plane, const Items& items) {
  ++stamp_;
  int total[2] = {0, 0};
  int laws[2] = {0, 0};
  int counted = 0;
  for (const CellItem& item : items) {
    if (item.thin) continue;
    ++counted;
    unsigned sure = 0;
    unsigned sides = geometry_.possible_sides(planes_[index(plane)], item, &sure);
    if (sides == kBoth && sure != kBoth) {
      sides = sides_of_region(plane, item.region);
      if (sides == kBoth && items.size() <= kExactScoring) {
        sides = geometry_.proved_sides(planes_[index(plane)], item, cell_, sides, sure);
      }
    }
    const int law = laws_.regions[index(item.region)].law;
    if (stamp_law_[index(law)] != stamp_) {
      stamp_law_[index(law)] = stamp_;
      law_sides_[index(law)] = 0;
    }
    for (int side = 0; side < 2; ++side) {
      const unsigned bit = side == 0 ? kBelow : kAbove;
      if ((sides & bit) == 0U) continue;
      ++total[side];
      if ((law_sides_[index(law)] & bit) == 0U) ++laws[side];
      law_sides_[index(law)] |= bit;
    }
  }
  // Nothing is won if one side keeps everything and the other side keeps everything or nothing.
  const auto all_or_none = [&](int n) { return n == 0 || n == counted; };
  if (all_or_none(total[0]) && all_or_none(total[1])) {
    return std::numeric_limits<double>::infinity();
  }
  const auto weight = [](int n) { return std::pow(n, kBalance); };
  return weight(laws[0]) + weight(laws[1]) + 1e-3 * (weight(total[0]) + weight(total[1]));
}

std::vector<Split> TreeBuilder::rank_splits(const Items& items, bool all_facets) {
  std::vector<int> candidates;
  const int mark = ++stamp_;
  for (const CellItem& item : items) {
    const auto gather = [&](const std::vector<int>& planes) {
      for (const int plane : planes) {
        if (stamp_plane_[index(plane)] == mark || in_use_[index(plane)] != 0) continue;
        if (!item.thin && !geometry_.touches(planes_[index(plane)], item)) continue;
        stamp_plane_[index(plane)] = mark;
        candidates.push_back(plane);
      }
    };
    gather(law_planes_[index(item.region)]);
    if (all_facets) gather(outer_planes_[index(item.region)]);
  }
  std::sort(candidates.begin(), candidates.end());
  const std::size_t stride = (candidates.size() + kMostCandidates - 1) / kMostCandidates;
  std::vector<Split> ranked;
  for (std::size_t first = 0; first < stride && ranked.empty(); ++first) {
    for (std::size_t k = first; k < candidates.size(); k += stride) {
      const double cost = cost_of(candidates[k], items);
      if (std::isfinite(cost)) ranked.push_back({candidates[k], cost});
    }
  }
  std::sort(ranked.begin(), ranked.end(), [](const Split& a, const Split& b) {
    return a.cost != b.cost ? a.cost < b.cost : a.plane < b.plane;
  });
  return ranked;
}

bool TreeBuilder::divide(const Items& items, int plane, Items& below, Items& above) {
  const Hyperplane& hyperplane = planes_[index(plane)];
  below.clear();
  above.clear();
  for (const CellItem& item : items) {
    unsigned sure = 0;
    unsigned sides =
        item.thin ? unsigned{kBoth} : geometry_.possible_sides(hyperplane, item, &sure);
    if (sides == kBoth && sure != kBoth) {
      sides = geometry_.proved_sides(hyperplane, item, cell_, sides, sure);
    }
    if (sides == kBelow) {
      below.push_back(item);
      continue;
    }
    if (sides == kAbove) {
      above.push_back(item);
      continue;
    }
    for (const bool up : {false, true}) {
      cell_.push(hyperplane, up);
      const CellGeometry::Presence presence = geometry_.presence(item.region, cell_);
      if (presence != CellGeometry::Presence::kAbsent) {
        CellItem part{item.region, presence == CellGeometry::Presence::kThin, nullptr};
        if (!part.thin) part.extent = geometry_.extent(item.region, cell_);
        (up ? above : below).push_back(std::move(part));
      }
      cell_.pop();
    }
  }
  const auto laws = [&](const Items& side) {
    ++stamp_;
    std::size_t count = 0;
    std::size_t there = 0;
    for (const CellItem& item : side) {
      if (item.thin) continue;
      ++there;
      const int law = laws_.regions[index(item.region)].law;
      count += stamp_law_[index(law)] != stamp_ ? 1U : 0U;
      stamp_law_[index(law)] = stamp_;
    }
    return std::pair(count, there);
  };
  const auto all = laws(items);
  const auto low = laws(below);
  const auto high = laws(above);
  const auto all_or_none = [&](const auto& side) { return side.second == 0 || side == all; };
  return !(all_or_none(low) && all_or_none(high));
}

// The bound on which the output sits in a cell that no unsaturated region enters: the value of
// the law at the first of them on a line from the cell into its surroundings.
int TreeBuilder::bound_in_cell(const Items& around, const Point& start) {
  double nearest = 0.5;
  int tried = 0;
  for (const CellItem& target : around) {
    if (target.thin) continue;
    if (++tried > 20) break;
    const double value = geometry_.first_output(start, target, around);
    if (std::abs(value) < 1e-7) return low_law_;
    if (std::abs(value - 1.0) < 1e-7) return high_law_;
    nearest = value;
  }
  if (everywhere_feasible_) {
    throw std::runtime_error(
        "search tree: a cell without unsaturated regions is not next to a saturated output; "
        "regions are missing from the solution");
  }
  ++tree_.statistics.infeasible_leaves;
  return nearest < 0.5 ? low_law_ : high_law_;
}

TreeBuilder::Child TreeBuilder::leaf(int law) {
  ++tree_.statistics.leaves;
  std::int32_t& piece = piece_of_law_[index(law)];
  if (piece < 0) {
    piece = static_cast<std::int32_t>(tree_.pieces.size());
    const ScaledLaw& scaled = laws_.laws[index(law)];
    const double range = output_.y_max - output_.y_min;
    AffinePiece affine{};
    affine.offset = output_.y_min + range * scaled[kMaxDimension];
    for (int j = 0; j < laws_.parameters; ++j) {
      affine.gain[j] = range * scaled[index(j)] / laws_.half_width(j);
      affine.offset -= affine.gain[j] * laws_.centre(j);
    }
    tree_.pieces.push_back(affine);
  }
  return {~piece, 0};
}

// True if everything in the cell is within the accepted difference of this law.
bool TreeBuilder::accept_as_leaf(const Items& items, int law, double difference) {
  for (const CellItem& item : items) {
    const int other = laws_.regions[index(item.region)].law;
    if (other == law || !item.extent) continue;
    for (const Point& point : item.extent->points) {
      if (std::abs(laws_.value(law, point.data()) - laws_.value(other, point.data())) >
          2.0 * difference) {
        return false;
      }
    }
  }
  for (const CellItem& item : items) {
    const int other = laws_.regions[index(item.region)].law;
    if (other == law) continue;
    if (!geometry_.difference_below(law, other, item, cell_, difference) ||
        !geometry_.difference_below(other, law, item, cell_, difference)) {
      return false;
    }
  }
  return true;
}

void TreeBuilder::promote_thin(Items& items) {
  for (CellItem& item : items) {
    if (!item.thin) continue;
    item.thin = false;
    item.extent = geometry_.extent(item.region, cell_);
  }
}

TreeBuilder::Child TreeBuilder::build(Items items, int depth) {
  if (depth > kMostDepth || static_cast<int>(tree_.nodes.size()) > options_.max_nodes) {
    throw std::runtime_error("search tree: more than " + std::to_string(options_.max_nodes) +
                             " nodes or " + std::to_string(kMostDepth) +
                             " levels; the law is too fragmented");
  }
  if (options_.progress && tree_.nodes.size() % 64 == 0 &&
      !options_.progress(static_cast<int>(tree_.nodes.size()), static_cast<int>(items.size()))) {
    throw Cancelled();
  }
  ++stamp_;
  int distinct = 0;
  std::vector<int> present;
  for (const CellItem& item : items) {
    const int law = laws_.regions[index(item.region)].law;
    if (item.thin || stamp_law_[index(law)] == stamp_) continue;
    stamp_law_[index(law)] = stamp_;
    ++distinct;
    if (present.size() < 4) present.push_back(law);
  }
  if (distinct <= 4) {
    for (const int law : present) {
      if (!accept_as_leaf(items, law, kAcceptedDifference)) continue;
      if (distinct > 1) ++tree_.statistics.sliver_leaves;
      return leaf(law);
    }
    if (distinct == 1) promote_thin(items);
  }
  Items below, above;
  for (const bool all_facets : {false, true}) {
    const std::vector<Split> ranked = rank_splits(items, all_facets);
    for (std::size_t k = 0; k < ranked.size(); ++k) {
      const int plane = ranked[k].plane;
      if (!divide(items, plane, below, above)) continue;
      Child children[2];
      bool exists[2] = {true, true};
      in_use_[index(plane)] = 1;
      for (const bool up : {false, true}) {
        cell_.push(planes_[index(plane)], up);
        Items& side = up ? above : below;
        const bool occupied =
            std::any_of(side.begin(), side.end(), [](const CellItem& item) { return !item.thin; });
        Child& child = children[up ? 1 : 0];
        if (occupied) {
          child = build(std::move(side), depth + 1);
        } else if (Point centre{}; geometry_.centre(cell_, &centre)) {
          child = leaf(bound_in_cell(items, centre));
        } else {
          exists[up ? 1 : 0] = false;
        }
        cell_.pop();
      }
      in_use_[index(plane)] = 0;
      // No point of the cell is further than rounding on the missing side.
      if (!exists[0] || !exists[1]) return children[exists[0] ? 0 : 1];
      if (children[0].code < 0 && children[0].code == children[1].code) return children[0];
      return {node_of(plane, children[0].code, children[1].code),
              1 + std::max(children[0].depth, children[1].depth)};
    }
  }
  for (const int law : present) {
    if (!accept_as_leaf(items, law, options_.accepted_difference)) continue;
    ++tree_.statistics.sliver_leaves;
    return leaf(law);
  }
  double largest = 0.0;
  for (const CellItem& item : items) {
    if (!item.extent) continue;
    for (const Point& point : item.extent->points) {
      const double y = laws_.value(laws_.regions[index(item.region)].law, point.data());
      largest = std::max(largest, std::abs(y - laws_.value(present.front(), point.data())));
    }
  }
  throw std::runtime_error("search tree: " + std::to_string(distinct) +
                           " laws in one cell that no facet separates and that differ by " +
                           std::to_string(largest * 1e9) + "e-9 of the output range");
}

// Neighbouring cells often end in the same splits; equal subtrees are kept once, which leaves
// less than half of the nodes on the ready rigs.
std::int32_t TreeBuilder::node_of(int plane, std::int32_t below, std::int32_t above) {
  const auto next = static_cast<std::int32_t>(tree_.nodes.size());
  const auto [entry, is_new] = node_codes_.try_emplace({plane, below, above}, next);
  if (is_new) {
    SplitNode node = in_problem_units(planes_[index(plane)], laws_);
    node.below = below;
    node.above = above;
    tree_.nodes.push_back(node);
  }
  return entry->second;
}

void TreeBuilder::check_insides(const BuiltSearchTree& tree) const {
  const BinaryTree view = tree.view();
  const double range = output_.y_max - output_.y_min;
  for (const LawRegion& region : laws_.regions) {
    double p[control::kMaxParameters] = {};
    for (int j = 0; j < laws_.parameters; ++j) {
      p[j] = laws_.centre(j) + laws_.half_width(j) * region.inside[index(j)];
    }
    const double found = (evaluate(view, p).u - output_.y_min) / range;
    const double right = laws_.value(region.law, region.inside.data());
    if (!(std::abs(std::clamp(found, 0.0, 1.0) - std::clamp(right, 0.0, 1.0)) < 1e-7)) {
      throw std::runtime_error("search tree: the finished tree disagrees with the regions");
    }
  }
}

BuiltSearchTree TreeBuilder::run() {
  Items items;
  for (std::size_t r = 0; r < laws_.regions.size(); ++r) {
    const int region = static_cast<int>(r);
    items.push_back({region, false, geometry_.extent(region, cell_)});
  }
  Child root;
  if (items.empty()) {
    if (laws_.saturated_low > 0 && laws_.saturated_high > 0) {
      throw std::runtime_error("search tree: the output jumps between its bounds");
    }
    root = leaf(laws_.saturated_low > 0 ? low_law_ : high_law_);
  } else {
    root = build(std::move(items), 0);
  }
  tree_.root = root.code;
  tree_.depth = root.depth;
  tree_.n_parameters = laws_.parameters;
  tree_.statistics.depth = root.depth;
  tree_.statistics.nodes = static_cast<int>(tree_.nodes.size());
  tree_.statistics.pieces = static_cast<int>(tree_.pieces.size());
  tree_.statistics.lps = geometry_.lp_count();
  check_insides(tree_);
  return std::move(tree_);
}

}  // namespace

BuiltSearchTree build_search_tree(const MpQpSolution& solution, const OutputLaw& output,
                                  const SearchTreeOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  TreeBuilder builder(distinct_output_laws(solution, output), output, options,
                      !solution.has_infeasible_parameters);
  BuiltSearchTree tree = builder.run();
  tree.statistics.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return tree;
}

}  // namespace eampc::law_design
