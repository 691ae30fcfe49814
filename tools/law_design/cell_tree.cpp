#include "law_design/cell_tree.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>

#include "law_design/cell_division.hpp"
#include "law_design/parallel_range.hpp"
#include "law_design/split_choice.hpp"

namespace eampc::law_design {
namespace {

constexpr int kMostDepth = 120;
// Deeper than any law needs whose cells can be divided well: from here on a cell is fitted with its
// slivers before it is divided once more.
constexpr int kPatience = 48;
// Cells at this depth, if they hold more regions than the second figure, are built in parallel.
constexpr int kTaskDepth = 6;
constexpr std::size_t kTaskRegions = 64;
// Cells with at most this many regions have their parts measured anew.
constexpr std::size_t kMeasured = 160;
// Of a leaf that no hyperplane divides.
constexpr int kMostPieces = 64;
// Items divided by all threads at once, and how many are worth it.
constexpr std::size_t kBatch = 8192, kWorthThreads = 512;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

using Items = std::vector<CellItem>;

/// What a subtree is made of; hyperplanes by value.
struct Growth {
  struct Node {
    Hyperplane plane;
    std::int32_t below, above;
  };
  std::vector<Node> nodes;
  std::vector<LatticeLeaf> leaves;
};

struct Task {
  Cell cell;
  Items items, bounds;
};

struct Shared {
  const LawPartition& partition;
  const CellTreeOptions& options;
  std::atomic<long> nodes{0};
  std::atomic<bool> stop{false};
  std::mutex progress;
};

/// Grows a subtree. Codes of tasks put off are kTask + number.
class Grower {
 public:
  static constexpr std::int32_t kTask = 1 << 30;
  static constexpr std::int32_t kNowhere = std::int32_t{1} << 29;  // a cell without parameters

  /// With `tasks` large cells below are put off; what is above them is divided by `threads`.
  Grower(Shared& shared, std::vector<Task>* tasks, int threads)
      : shared_(shared),
        partition_(shared.partition),
        divisions_(divisions(shared.partition, threads)),
        geometry_(divisions_.front()->geometry()),
        fitter_(shared.partition, geometry_),
        splits_(shared.partition),
        cell_(shared.partition.parameters),
        tasks_(tasks) {}

  std::int32_t grow(Cell cell, Items items, Items bounds) {
    cell_ = std::move(cell);
    return grow(std::move(items), std::move(bounds), 0);
  }
  Growth take() { return std::move(growth_); }
  long lps() const {
    long count = 0;
    for (const std::unique_ptr<CellDivision>& division : divisions_) {
      count += division->geometry().lp_count();
    }
    return count;
  }

 private:
  using CellDivisions = std::vector<std::unique_ptr<CellDivision>>;
  static CellDivisions divisions(const LawPartition& partition, int threads) {
    CellDivisions result;
    for (int t = 0; t < threads; ++t) result.push_back(std::make_unique<CellDivision>(partition));
    return result;
  }

  std::int32_t grow(Items items, Items bounds, int depth);
  std::int32_t leaf(LatticeLeaf leaf);
  bool divide(const Items& items, const Hyperplane& plane, bool measure, Items& below,
              Items& above);
  std::optional<LatticeLeaf> fit_with_slivers(Items items, const Items& bounds);
  void tick();

  Shared& shared_;
  const LawPartition& partition_;
  CellDivisions divisions_;
  CellGeometry& geometry_;
  LatticeFitter fitter_;
  SplitChoice splits_;
  Cell cell_;
  std::vector<Task>* tasks_;
  Growth growth_;
};

void Grower::tick() {
  const long nodes = ++shared_.nodes;
  if (nodes > shared_.options.max_nodes) {
    throw std::runtime_error("cell tree: more than " + std::to_string(shared_.options.max_nodes) +
                             " nodes; the law is too fragmented");
  }
  if (shared_.stop) throw Cancelled();
  if (nodes % 16 != 0 || !shared_.options.progress) return;
  const std::lock_guard lock(shared_.progress);
  if (!shared_.options.progress(nodes, 0)) {
    shared_.stop = true;
    throw Cancelled();
  }
}

std::int32_t Grower::leaf(LatticeLeaf leaf) {
  growth_.leaves.push_back(std::move(leaf));
  return ~static_cast<std::int32_t>(growth_.leaves.size() - 1);
}

// Divides the items; false if one side keeps all of them and the other all or none.
bool Grower::divide(const Items& items, const Hyperplane& plane, bool measure, Items& below,
                    Items& above) {
  below.clear();
  above.clear();
  const auto take = [&](const CellItem& item, DividedItem&& parts) {
    if (parts.whole == DividedItem::Whole::kBelow) below.push_back(item);
    if (parts.whole == DividedItem::Whole::kAbove) above.push_back(item);
    if (parts.parts[0]) below.push_back(std::move(*parts.parts[0]));
    if (parts.parts[1]) above.push_back(std::move(*parts.parts[1]));
  };
  const std::size_t many = divisions_.size() > 1 ? kWorthThreads : items.size();
  for (std::unique_ptr<CellDivision>& division : divisions_) division->enter(cell_, plane);
  for (std::size_t first = 0; first < items.size(); first += kBatch) {
    const std::size_t last = std::min(items.size(), first + kBatch);
    if (last - first < many) {
      for (std::size_t i = first; i < last; ++i) {
        take(items[i], divisions_.front()->divide(items[i], measure));
      }
      continue;
    }
    std::vector<DividedItem> parts(last - first);
    parallel_range(static_cast<int>(last - first), static_cast<int>(divisions_.size()),
                   [&](int i, int thread) {
                     parts[index(i)] =
                         divisions_[index(thread)]->divide(items[first + index(i)], measure);
                   });
    for (std::size_t i = first; i < last; ++i) take(items[i], std::move(parts[i - first]));
  }
  const auto there = [](const Items& side) {
    return std::count_if(side.begin(), side.end(), [](const CellItem& i) { return !i.thin; });
  };
  const auto all = there(items);
  const auto all_or_none = [&](const Items& side) {
    const auto n = there(side);
    return n == 0 || n == all;
  };
  return !(all_or_none(below) && all_or_none(above));
}

// What is left is as small as the rounding of facets: slivers count as regions, and if that is not
// enough a difference counts as none that elsewhere is one.
std::optional<LatticeLeaf> Grower::fit_with_slivers(Items items, const Items& bounds) {
  for (CellItem& item : items) item.thin = false;
  for (const double same : {1e-9, 1e-7, 1e-6}) {
    if (auto found = fitter_.fit(items, bounds, cell_, {kMostPieces, kMostPieces, same})) {
      return found;
    }
  }
  return std::nullopt;
}

std::int32_t Grower::grow(Items items, Items bounds, int depth) {
  tick();
  if (depth > kMostDepth) {
    throw std::runtime_error("cell tree: more than " + std::to_string(kMostDepth) +
                             " levels; the law is too fragmented");
  }
  if (tasks_ != nullptr && depth == kTaskDepth && items.size() > kTaskRegions) {
    tasks_->push_back({cell_, std::move(items), std::move(bounds)});
    return kTask + static_cast<std::int32_t>(tasks_->size() - 1);
  }
  const bool occupied =
      std::any_of(items.begin(), items.end(), [](const CellItem& item) { return !item.thin; });
  Point centre{};
  if (!occupied && !geometry_.centre(cell_, &centre)) return kNowhere;
  if (auto found = fitter_.fit(items, bounds, cell_, shared_.options.limits)) {
    return leaf(std::move(*found));
  }
  if (!occupied) {
    // Saturated throughout, or without a solution throughout, or a mixture of these.
    const auto present = std::any_of(bounds.begin(), bounds.end(), [&](CellItem item) {
      return geometry_.presence(cell_, item) != CellGeometry::Presence::kAbsent;
    });
    if (!present && !partition_.everywhere_feasible) return kNowhere;
  }
  if (depth > kPatience) {
    if (auto found = fit_with_slivers(items, bounds)) return leaf(std::move(*found));
  }
  Items below, above;
  const std::vector<Hyperplane> hints = fitter_.hints();
  for (const bool all : {false, true}) {
    for (const RankedSplit& split : splits_.rank(occupied ? items : bounds, hints, all)) {
      const bool measure = items.size() <= kMeasured;
      if (!divide(items, split.plane, measure, below, above) && occupied) continue;
      Items bounds_below, bounds_above;
      divide(bounds, split.plane, false, bounds_below, bounds_above);
      items = Items();
      bounds = Items();
      const std::size_t at = growth_.nodes.size();
      growth_.nodes.push_back({split.plane, 0, 0});
      std::int32_t codes[2];
      for (const bool up : {false, true}) {
        cell_.push(split.plane, up);
        codes[up ? 1 : 0] = grow(std::move(up ? above : below),
                                 std::move(up ? bounds_above : bounds_below), depth + 1);
        cell_.pop();
      }
      growth_.nodes[at].below = codes[0];
      growth_.nodes[at].above = codes[1];
      return static_cast<std::int32_t>(at);
    }
  }
  if (auto found = fit_with_slivers(items, bounds)) return leaf(std::move(*found));
  throw std::runtime_error("cell tree: " + std::to_string(items.size()) +
                           " regions meet in a cell that no hyperplane divides and no lattice of "
                           "their laws fits; the problem is too ill-conditioned");
}

/// Puts subtrees together; equal leaves, hyperplanes and subtrees are kept once.
class Assembly {
 public:
  explicit Assembly(CellTree& tree) : tree_(tree) {}

  struct Part {
    std::int32_t code = 0;
    int depth = 0;
  };

  Part add(const Growth& growth, std::int32_t code, const std::vector<Part>& tasks) {
    if (code >= Grower::kTask) return tasks[index(code - Grower::kTask)];
    if (code == Grower::kNowhere) return {Grower::kNowhere, 0};
    if (code < 0) return {~leaf(growth.leaves[index(~code)]), 0};
    const Growth::Node& node = growth.nodes[index(code)];
    const Part below = add(growth, node.below, tasks);
    const Part above = add(growth, node.above, tasks);
    if (below.code == Grower::kNowhere || below.code == above.code) return above;
    if (above.code == Grower::kNowhere) return below;
    return {this->node(plane(node.plane), below.code, above.code),
            1 + std::max(below.depth, above.depth)};
  }

 private:
  std::int32_t leaf(const LatticeLeaf& leaf) {
    const auto [entry, is_new] =
        leaves_.try_emplace(leaf, static_cast<std::int32_t>(tree_.leaves.size()));
    if (is_new) tree_.leaves.push_back(leaf);
    return entry->second;
  }
  int plane(const Hyperplane& plane) {
    std::array<double, kMaxDimension + 1> key{};
    std::copy(plane.normal.begin(), plane.normal.end(), key.begin());
    key[kMaxDimension] = plane.offset;
    const auto [entry, is_new] = planes_.try_emplace(key, static_cast<int>(tree_.planes.size()));
    if (is_new) tree_.planes.push_back(plane);
    return entry->second;
  }
  std::int32_t node(int plane, std::int32_t below, std::int32_t above) {
    const auto [entry, is_new] =
        nodes_.try_emplace({plane, below, above}, static_cast<std::int32_t>(tree_.nodes.size()));
    if (is_new) tree_.nodes.push_back({plane, below, above});
    return entry->second;
  }

  CellTree& tree_;
  std::map<LatticeLeaf, std::int32_t> leaves_;
  std::map<std::array<double, kMaxDimension + 1>, int> planes_;
  std::map<std::array<std::int32_t, 3>, std::int32_t> nodes_;
};

struct Grown {
  Growth growth;
  std::int32_t code = 0;
  long lps = 0;
  std::exception_ptr error;
};

std::vector<Grown> grow_tasks(Shared& shared, std::vector<Task>& tasks) {
  std::vector<Grown> grown(tasks.size());
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t t = next++; t < tasks.size(); t = next++) {
      try {
        Grower grower(shared, nullptr, 1);
        grown[t].code = grower.grow(std::move(tasks[t].cell), std::move(tasks[t].items),
                                    std::move(tasks[t].bounds));
        grown[t].lps = grower.lps();
        grown[t].growth = grower.take();
      } catch (...) {
        grown[t].error = std::current_exception();
        shared.stop = true;
      }
    }
  };
  const int wanted = thread_count(shared.options.threads);
  std::vector<std::jthread> helpers;
  for (int t = 1; t < wanted; ++t) helpers.emplace_back(work);
  work();
  helpers.clear();
  std::exception_ptr cancelled;
  for (const Grown& part : grown) {
    if (!part.error) continue;
    try {
      std::rethrow_exception(part.error);
    } catch (const Cancelled&) {
      cancelled = part.error;
    }
  }
  if (cancelled) std::rethrow_exception(cancelled);
  return grown;
}

}  // namespace

CellTree build_cell_tree(const LawPartition& partition, const CellTreeOptions& options) {
  Shared shared{partition, options, {}, {}, {}};
  Items items, bounds;
  for (std::size_t r = 0; r < partition.regions.size(); ++r) {
    const LawRegion& region = partition.regions[r];
    CellItem item{static_cast<int>(r), region.radius <= CellGeometry::kThin, region.inside,
                  region.radius, region.extent};
    (partition.is_bound(region.law) ? bounds : items).push_back(std::move(item));
  }
  std::vector<Task> tasks;
  Grower top(shared, &tasks, thread_count(options.threads));
  const std::int32_t root =
      top.grow(Cell(partition.parameters), std::move(items), std::move(bounds));
  std::vector<Grown> grown = grow_tasks(shared, tasks);

  CellTree tree;
  tree.lps = top.lps();
  Assembly assembly(tree);
  std::vector<Assembly::Part> parts;
  for (const Grown& part : grown) {
    tree.lps += part.lps;
    parts.push_back(assembly.add(part.growth, part.code, {}));
  }
  const Assembly::Part whole = assembly.add(top.take(), root, parts);
  tree.root = whole.code;
  tree.depth = whole.depth;
  return tree;
}

}  // namespace eampc::law_design
