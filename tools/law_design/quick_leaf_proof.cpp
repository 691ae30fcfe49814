#include "law_design/quick_leaf_proof.hpp"

#include <algorithm>
#include <cstddef>

namespace eampc::law_design {
namespace {

constexpr std::size_t kMostPoints = 48;

}  // namespace

QuickLeafProof::QuickLeafProof(const service::LawTables& tables,
                               const std::vector<AffineForm>& pieces, DoubleArena& arena,
                               double tolerance)
    : tables_(tables),
      pieces_(pieces),
      arena_(arena),
      proof_(tables, pieces, arena),
      tolerance_(tolerance),
      np_(static_cast<std::size_t>(tables.n_parameters)),
      known_(pieces.size()) {}

void QuickLeafProof::start(const AffineForm& own, double low, double high, const Point& lower,
                           const Point& upper, const std::vector<Point>& points) {
  own_ = own;
  low_ = low;
  high_ = high;
  lower_ = lower;
  upper_ = upper;
  region_points_ = points;
  ++region_;
  // Where the output is saturated it is compared with its bound: that is enough, wherever it is.
  target_ = own;
  if (high <= tolerance_ || low >= 1.0 - tolerance_) {
    target_.fill(0.0);
    target_[np_] = high <= tolerance_ ? 0.0 : 1.0;
  }
}

AffineForm QuickLeafProof::difference(int piece, Side side) const {
  AffineForm form{};
  const AffineForm& y = pieces_[at(piece)];
  for (std::size_t c = 0; c <= np_; ++c) {
    form[c] = side == kAbove ? y[c] - target_[c] : target_[c] - y[c];
  }
  return form;
}

double QuickLeafProof::value(const AffineForm& form, const Point& q) const {
  double sum = form[np_];
  for (std::size_t j = 0; j < np_; ++j) sum += form[j] * q[j];
  return sum;
}

// The piece at the points known by now.
QuickLeafProof::Comparison& QuickLeafProof::look(int piece) {
  Comparison& known = known_[at(piece)];
  if (known.region != region_) {
    known = Comparison{};
    known.region = region_;
  }
  if (known.cell != cell_) {
    known.cell = cell_;
    known.in_cell[kAbove] = known.in_cell[kBelow] = Known::kNothing;
    known.most[kAbove] = known.most[kBelow] = -1e300;
    known.sum = 0.0;
    known.seen = 0;
  }
  if (known.seen == points_.size()) return known;
  const AffineForm form = difference(piece, kAbove);
  for (; known.seen < points_.size(); ++known.seen) {
    const double excess = value(form, points_[known.seen]);
    known.most[kAbove] = std::max(known.most[kAbove], excess);
    known.most[kBelow] = std::max(known.most[kBelow], -excess);
    known.sum += excess;
  }
  return known;
}

bool QuickLeafProof::holds_in_region(int piece, Side side) {
  Known& known = look(piece).in_region[side];
  if (known != Known::kNothing) return known == Known::kYes;
  const AffineForm form = difference(piece, side);
  double most = form[np_];
  for (std::size_t j = 0; j < np_; ++j) {
    most += std::max(form[j] * lower_[j], form[j] * upper_[j]);
  }
  known = Known::kYes;
  if (most <= tolerance_) return true;
  for (const Point& q : region_points_) {
    if (value(form, q) <= tolerance_) continue;
    known = Known::kNo;
    return false;
  }
  const HalfSpaces* parts[] = {arena_.facets};
  Point q{};
  if (arena_.reaches(form, tolerance_, parts, &q)) {
    known = Known::kNo;
    if (region_points_.size() < kMostPoints) region_points_.push_back(q);
  }
  return known == Known::kYes;
}

bool QuickLeafProof::holds_in_cell(int piece, Side side) {
  if (holds_in_region(piece, side)) return true;
  Known& known = look(piece).in_cell[side];
  if (known != Known::kNothing) return known == Known::kYes;
  known = Known::kNo;
  if (refuted(piece, side)) return false;
  const HalfSpaces* parts[] = {arena_.facets, &arena_.cell};
  Point q{};
  if (!arena_.reaches(difference(piece, side), tolerance_, parts, &q)) {
    known = Known::kYes;
    return true;
  }
  if (points_.size() < kMostPoints) points_.push_back(q);
  return false;
}

bool QuickLeafProof::not_too_high(int term) {
  const auto begin = tables_.term_pieces.begin() + tables_.term_first[at(term)];
  const auto end = tables_.term_pieces.begin() + tables_.term_first[at(term + 1)];
  candidates_.clear();
  for (auto piece = begin; piece != end; ++piece) {
    const Comparison& known = look(*piece);
    if (known.in_region[kAbove] == Known::kYes || known.in_cell[kAbove] == Known::kYes) return true;
    if (!refuted(*piece, kAbove)) candidates_.push_back(*piece);
  }
  std::sort(candidates_.begin(), candidates_.end(), [&](int a, int b) {
    const double of_a = known_[at(a)].sum;
    const double of_b = known_[at(b)].sum;
    return of_a < of_b || (of_a == of_b && a < b);
  });
  for (const int piece : candidates_) {
    if (holds_in_region(piece, kAbove)) return true;
  }
  for (const int piece : candidates_) {
    if (holds_in_cell(piece, kAbove)) return true;
  }
  return proof_.not_too_high(term, own_, tolerance_);
}

bool QuickLeafProof::not_too_low(int leaf) {
  if (high_ <= tolerance_) return true;
  const auto all = [&](int term, const auto& holds) {
    const auto begin = tables_.term_pieces.begin();
    return std::all_of(begin + tables_.term_first[at(term)],
                       begin + tables_.term_first[at(term + 1)], holds);
  };
  const auto not_refuted = [&](int piece) { return !refuted(piece, kBelow); };
  const auto in_region = [&](int piece) { return look(piece).in_region[kBelow] == Known::kYes; };
  const int first = tables_.leaf_first[at(leaf)];
  const int last = tables_.leaf_first[at(leaf + 1)];
  for (int term = first; term < last; ++term) {
    if (all(term, in_region)) return true;
  }
  for (int term = first; term < last; ++term) {
    if (all(term, not_refuted) &&
        all(term, [&](int piece) { return holds_in_cell(piece, kBelow); })) {
      return true;
    }
  }
  return proof_.not_too_low(leaf, own_, high_, tolerance_);
}

bool QuickLeafProof::prove(int leaf, const std::vector<Point>& points) {
  ++cell_;
  points_ = points;
  arena_.cut(0);
  if (!not_too_low(leaf)) return false;
  if (low_ >= 1.0 - tolerance_) return true;
  for (int term = tables_.leaf_first[at(leaf)]; term < tables_.leaf_first[at(leaf + 1)]; ++term) {
    if (!not_too_high(term)) return false;
  }
  return true;
}

}  // namespace eampc::law_design
