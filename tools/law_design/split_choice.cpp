#include "law_design/split_choice.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace eampc::law_design {
namespace {

// Cost of a side with n laws is n^kBalance: close to the larger of both, yet smooth.
constexpr double kBalance = 4.0;
// Plane × item tests spent on one choice, and the bounds of the number of planes that gives.
constexpr std::size_t kTests = 120'000;
constexpr std::size_t kFewest = 24, kMost = 300;
// With more than this share of the laws left on one side, other hyperplanes than facets are tried.
constexpr double kPoor = 0.8;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

// Every k-th entry, so that at most `most` are left.
template <typename T>
void thin_out(std::vector<T>& all, std::size_t most) {
  if (all.size() <= most) return;
  const double stride = static_cast<double>(all.size()) / static_cast<double>(most);
  for (std::size_t i = 0; i < most; ++i) {
    all[i] = all[static_cast<std::size_t>(static_cast<double>(i) * stride)];
  }
  all.resize(most);
}

}  // namespace

SplitChoice::SplitChoice(const LawPartition& partition)
    : partition_(partition),
      stamp_plane_(partition.planes.size(), 0),
      stamp_law_(partition.laws.size(), 0),
      sides_of_law_(partition.laws.size(), 0) {}

double SplitChoice::cost(const Hyperplane& plane, const std::vector<CellItem>& items) {
  ++stamp_;
  int laws[2] = {0, 0};
  int parts[2] = {0, 0};
  int counted = 0;
  for (const CellItem& item : items) {
    if (item.thin) continue;
    ++counted;
    const double middle = plane.excess(item.inside);
    unsigned sides = 0;
    if (middle < item.radius - CellGeometry::kThin) sides |= 1U;
    if (middle > CellGeometry::kThin - item.radius) sides |= 2U;
    for (std::size_t k = 0; k < item.extent.points.size() && sides != 3U; ++k) {
      const double excess = plane.excess(item.extent.points[k]);
      if (excess > 1e-7) sides |= 2U;
      if (excess < -1e-7) sides |= 1U;
    }
    const std::size_t law = index(partition_.regions[index(item.region)].law);
    if (stamp_law_[law] != stamp_) {
      stamp_law_[law] = stamp_;
      sides_of_law_[law] = 0;
    }
    for (unsigned side = 0; side < 2U; ++side) {
      const unsigned bit = 1U << side;
      if ((sides & bit) == 0U) continue;
      ++parts[side];
      if ((sides_of_law_[law] & bit) == 0U) ++laws[side];
      sides_of_law_[law] = static_cast<unsigned char>(sides_of_law_[law] | bit);
    }
  }
  const auto all_or_none = [&](int n) { return n == 0 || n == counted; };
  if (all_or_none(parts[0]) && all_or_none(parts[1])) {
    return std::numeric_limits<double>::infinity();
  }
  const auto weight = [](int n) { return std::pow(n, kBalance); };
  return weight(laws[0]) + weight(laws[1]) + 1e-3 * (weight(parts[0]) + weight(parts[1]));
}

void SplitChoice::facets(const std::vector<CellItem>& items, std::size_t most) {
  const int mark = ++stamp_;
  std::vector<int> ids;
  for (const CellItem& item : items) {
    for (const int id : partition_.regions[index(item.region)].planes) {
      if (stamp_plane_[index(id)] == mark) continue;
      const Hyperplane& plane = partition_.planes[index(id)];
      double middle = -plane.offset;
      double reach = 0.0;
      for (int j = 0; j < partition_.parameters; ++j) {
        const double a = 0.5 * plane.normal[index(j)];
        middle += a * (item.extent.upper[index(j)] + item.extent.lower[index(j)]);
        reach += std::abs(a) * (item.extent.upper[index(j)] - item.extent.lower[index(j)]);
      }
      if (std::abs(middle) > reach + CellGeometry::kSide) continue;
      stamp_plane_[index(id)] = mark;
      ids.push_back(id);
    }
  }
  std::sort(ids.begin(), ids.end());
  thin_out(ids, most);
  for (const int id : ids) candidates_.push_back(partition_.planes[index(id)]);
}

void SplitChoice::law_differences(const std::vector<CellItem>& items, std::size_t most) {
  std::vector<int> laws;
  for (const CellItem& item : items) {
    if (!item.thin) laws.push_back(partition_.regions[index(item.region)].law);
  }
  std::sort(laws.begin(), laws.end());
  laws.erase(std::unique(laws.begin(), laws.end()), laws.end());
  thin_out(laws, 40);
  std::vector<Hyperplane> planes;
  for (std::size_t a = 0; a < laws.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      const ScaledLaw& x = partition_.laws[index(laws[a])];
      const ScaledLaw& y = partition_.laws[index(laws[b])];
      Hyperplane plane;
      double norm = 0.0;
      for (std::size_t j = 0; j < kMaxDimension; ++j) {
        plane.normal[j] = x[j] - y[j];
        norm += plane.normal[j] * plane.normal[j];
      }
      norm = std::sqrt(norm);
      if (norm < 1e-7) continue;
      for (double& n : plane.normal) n /= norm;
      plane.offset = (y[kMaxDimension] - x[kMaxDimension]) / norm;
      planes.push_back(plane);
    }
  }
  thin_out(planes, most);
  candidates_.insert(candidates_.end(), planes.begin(), planes.end());
}

void SplitChoice::medians(const std::vector<CellItem>& items) {
  std::vector<double> values;
  for (int j = 0; j < partition_.parameters; ++j) {
    values.clear();
    for (const CellItem& item : items) {
      if (!item.thin) values.push_back(item.inside[index(j)]);
    }
    if (values.empty()) return;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    Hyperplane plane;
    plane.normal[index(j)] = 1.0;
    plane.offset = *middle;
    candidates_.push_back(plane);
  }
}

std::vector<RankedSplit> SplitChoice::rank(const std::vector<CellItem>& items,
                                           const std::vector<Hyperplane>& hints, bool all) {
  const std::size_t most =
      all ? 100'000 : std::clamp(kTests / std::max<std::size_t>(items.size(), 1), kFewest, kMost);
  std::vector<RankedSplit> ranked;
  const auto judge = [&] {
    for (const Hyperplane& plane : candidates_) {
      const double c = cost(plane, items);
      if (std::isfinite(c)) ranked.push_back({plane, c});
    }
    candidates_.clear();
    std::stable_sort(ranked.begin(), ranked.end(),
                     [](const RankedSplit& a, const RankedSplit& b) { return a.cost < b.cost; });
  };
  facets(items, most);
  candidates_.insert(candidates_.end(), hints.begin(), hints.end());
  judge();
  ++stamp_;
  int laws = 0;
  for (const CellItem& item : items) {
    const std::size_t law = index(partition_.regions[index(item.region)].law);
    if (item.thin || stamp_law_[law] == stamp_) continue;
    stamp_law_[law] = stamp_;
    ++laws;
  }
  if (all || ranked.empty() || ranked.front().cost > std::pow(kPoor * laws, kBalance)) {
    law_differences(items, most);
    medians(items);
    judge();
  }
  return ranked;
}

}  // namespace eampc::law_design
