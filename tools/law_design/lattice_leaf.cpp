#include "law_design/lattice_leaf.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

bool contains(const std::vector<int>& sorted, int x) {
  return std::binary_search(sorted.begin(), sorted.end(), x);
}

}  // namespace

int lattice_rows(const LatticeLeaf& leaf) {
  std::vector<std::size_t> lengths;
  for (const std::vector<int>& term : leaf.terms) lengths.push_back(term.size());
  if (lengths.size() == 1) return static_cast<int>((lengths.front() + 7) / 8);
  std::sort(lengths.rbegin(), lengths.rend());
  std::size_t rows = 0;
  for (std::size_t first = 0; first < lengths.size(); first += 8) rows += lengths[first];
  return static_cast<int>(rows);
}

void LatticeFitter::collect(const std::vector<CellItem>& items,
                            const std::vector<CellItem>& bounds) {
  laws_.clear();
  for (const CellItem& item : items) {
    if (!item.thin) laws_.push_back(partition_.regions[index(item.region)].law);
  }
  std::sort(laws_.begin(), laws_.end());
  laws_.erase(std::unique(laws_.begin(), laws_.end()), laws_.end());
  parts_.clear();
  const auto add = [&](const CellItem& item) {
    if (item.thin) return;
    const int law = partition_.regions[index(item.region)].law;
    Part part{&item, Kind::kLaw, -1, std::vector<signed char>(laws_.size(), -1),
              std::vector<signed char>(laws_.size(), -1)};
    if (partition_.is_bound(law)) {
      part.kind = law == partition_.low_law() ? Kind::kLow : Kind::kHigh;
    } else {
      part.law =
          static_cast<int>(std::lower_bound(laws_.begin(), laws_.end(), law) - laws_.begin());
    }
    parts_.push_back(std::move(part));
  };
  std::for_each(items.begin(), items.end(), add);
  std::for_each(bounds.begin(), bounds.end(), add);
}

bool LatticeFitter::nowhere_below(Part& part, int law, const Cell& cell) {
  signed char& known = part.above[index(law)];
  if (known < 0) {
    const int own = partition_.regions[index(part.item->region)].law;
    known = law == part.law ||
            geometry_.difference_below(own, laws_[index(law)], *part.item, cell, same_);
  }
  return known == 1;
}

bool LatticeFitter::nowhere_above(Part& part, int law, const Cell& cell) {
  signed char& known = part.below[index(law)];
  if (known < 0) {
    const int own = partition_.regions[index(part.item->region)].law;
    known = law == part.law ||
            geometry_.difference_below(laws_[index(law)], own, *part.item, cell, same_);
  }
  return known == 1;
}

// The term is the part's law there, or at y_max nowhere below it.
bool LatticeFitter::serves(const std::vector<int>& term, Part& part, const Cell& cell) {
  return (part.kind == Kind::kHigh || contains(term, part.law)) &&
         std::all_of(term.begin(), term.end(),
                     [&](int law) { return nowhere_below(part, law, cell); });
}

bool LatticeFitter::none_above(const std::vector<int>& term, Part& part, const Cell& cell) {
  if (part.kind == Kind::kHigh || contains(term, part.law)) return true;
  if (std::any_of(term.begin(), term.end(), [&](int law) { return part.below[index(law)] == 1; }) ||
      std::any_of(term.begin(), term.end(),
                  [&](int law) { return nowhere_above(part, law, cell); })) {
    return true;
  }
  std::vector<int> laws;
  for (const int law : term) laws.push_back(laws_[index(law)]);
  return geometry_.none_above(laws, *part.item, cell, same_);
}

bool LatticeFitter::find_terms(const Cell& cell, Terms& terms) {
  const int n = static_cast<int>(laws_.size());
  const auto all_above = [&](Part& part) {
    std::vector<int> term;
    for (int law = 0; law < n; ++law) {
      if (nowhere_below(part, law, cell)) term.push_back(law);
    }
    return term;
  };
  // The shortest first: they may serve other parts as well.
  std::vector<std::pair<std::vector<int>, Part*>> own;
  for (Part& part : parts_) {
    if (part.kind == Kind::kLaw) own.emplace_back(all_above(part), &part);
  }
  std::stable_sort(own.begin(), own.end(),
                   [](const auto& a, const auto& b) { return a.first.size() < b.first.size(); });
  const auto served = [&](Part& part) {
    return std::any_of(terms.begin(), terms.end(),
                       [&](const std::vector<int>& term) { return serves(term, part, cell); });
  };
  for (auto& [term, part] : own) {
    if (!served(*part)) terms.push_back(std::move(term));
  }
  for (Part& part : parts_) {
    if (part.kind != Kind::kHigh || served(part)) continue;
    std::vector<int> term = all_above(part);
    if (!term.empty()) {
      terms.push_back(std::move(term));
      continue;
    }
    Terms laws = terms;
    for (std::vector<int>& of_term : laws) {
      for (int& law : of_term) law = laws_[index(law)];
    }
    if (!geometry_.some_reach_top(laws, *part.item, cell, same_)) return false;
  }
  for (Part& part : parts_) {
    for (const std::vector<int>& term : terms) {
      if (none_above(term, part, cell)) continue;
      hint_at(term, part);
      return false;
    }
  }
  return true;
}

void LatticeFitter::hint_at(const std::vector<int>& term, const Part& above) {
  constexpr std::size_t kMost = 8;
  const ScaledLaw& limit =
      partition_.laws[index(partition_.regions[index(above.item->region)].law)];
  const auto at = [&](const ScaledLaw& law) {
    double y = law[kMaxDimension];
    for (std::size_t j = 0; j < kMaxDimension; ++j) y += law[j] * above.item->inside[j];
    return y;
  };
  for (const Part& part : parts_) {
    if (part.kind != Kind::kLaw || !contains(term, part.law)) continue;
    for (std::size_t j = 0; j < laws_.size() && hints_.size() < kMost; ++j) {
      if (contains(term, static_cast<int>(j)) || part.above[j] != 0 || part.below[j] == 1) continue;
      const ScaledLaw& other = partition_.laws[index(laws_[j])];
      if (at(other) > at(limit) + 1e-9) continue;
      const ScaledLaw& own = partition_.laws[index(laws_[index(part.law)])];
      Hyperplane plane;
      double norm = 0.0;
      for (std::size_t k = 0; k < kMaxDimension; ++k) {
        plane.normal[k] = other[k] - own[k];
        norm += plane.normal[k] * plane.normal[k];
      }
      norm = std::sqrt(norm);
      if (norm < 1e-7) continue;
      for (double& a : plane.normal) a /= norm;
      plane.offset = (own[kMaxDimension] - other[kMaxDimension]) / norm;
      hints_.push_back(plane);
    }
  }
}

// A term need not hold a law that another of its laws does the work of.
void LatticeFitter::drop_spare_laws(Terms& terms, const Cell& cell) {
  for (std::vector<int>& term : terms) {
    for (std::size_t k = term.size(); k-- > 0 && term.size() > 1;) {
      std::vector<int> rest = term;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(k));
      const bool spare = std::all_of(parts_.begin(), parts_.end(), [&](Part& part) {
        if (part.kind == Kind::kHigh || contains(rest, part.law)) return true;
        if (part.law == term[k] &&
            std::none_of(terms.begin(), terms.end(), [&](const std::vector<int>& other) {
              return &other != &term && serves(other, part, cell);
            })) {
          return false;
        }
        return std::any_of(rest.begin(), rest.end(),
                           [&](int law) { return nowhere_above(part, law, cell); });
      });
      if (spare) term = std::move(rest);
    }
  }
}

bool LatticeFitter::proved_on_sliver(const Terms& terms, const CellItem& item, const Cell& cell) {
  const int own = partition_.regions[index(item.region)].law;
  const auto below = [&](int a, int b) {
    return a == b || geometry_.clipped_difference_below(a, b, item, cell, kSameOnSliver);
  };
  const bool reached =
      own == partition_.low_law() ||
      std::any_of(terms.begin(), terms.end(), [&](const std::vector<int>& term) {
        return std::all_of(term.begin(), term.end(), [&](int law) { return below(own, law); });
      });
  if (!reached) return false;
  if (own == partition_.high_law()) return true;
  return std::all_of(terms.begin(), terms.end(), [&](const std::vector<int>& term) {
    return std::any_of(term.begin(), term.end(), [&](int law) { return below(law, own); }) ||
           geometry_.none_above(term, item, cell, kSameOnSliver);
  });
}

std::optional<LatticeLeaf> LatticeFitter::fit(const std::vector<CellItem>& items,
                                              const std::vector<CellItem>& bounds, const Cell& cell,
                                              const LatticeLimits& limits) {
  hints_.clear();
  same_ = limits.same;
  collect(items, bounds);
  if (static_cast<int>(laws_.size()) > limits.pieces) return std::nullopt;
  LatticeLeaf leaf;
  if (laws_.empty()) {
    // Saturated throughout, on one side.
    const auto any = [&](Kind kind) {
      return std::any_of(parts_.begin(), parts_.end(),
                         [&](const Part& part) { return part.kind == kind; });
    };
    if (any(Kind::kLow) == any(Kind::kHigh)) return std::nullopt;
    leaf.terms = {{any(Kind::kLow) ? partition_.low_law() : partition_.high_law()}};
  } else {
    Terms terms;
    if (!find_terms(cell, terms)) return std::nullopt;
    drop_spare_laws(terms, cell);
    for (std::vector<int>& term : terms) {
      for (int& law : term) law = laws_[index(law)];
    }
    std::sort(terms.begin(), terms.end());
    terms.erase(std::unique(terms.begin(), terms.end()), terms.end());
    leaf.terms = std::move(terms);
    if (lattice_rows(leaf) > limits.rows) return std::nullopt;
  }
  const auto proved = [&](const CellItem& item) {
    return !item.thin || proved_on_sliver(leaf.terms, item, cell);
  };
  if (!std::all_of(items.begin(), items.end(), proved) ||
      !std::all_of(bounds.begin(), bounds.end(), proved)) {
    return std::nullopt;
  }
  return leaf;
}

}  // namespace eampc::law_design
