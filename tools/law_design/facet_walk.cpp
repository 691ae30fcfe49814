#include "law_design/facet_walk.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>

namespace eampc::law_design {
namespace {

using Eigen::Index;
using Kind = FacetWalkResult::Kind;

// More flat active sets than this behind one facet are not a gap but a mistake.
constexpr int kDeepest = 24;
// Coefficients of a dependent row below this count as zero.
constexpr double kZero = 1e-10;

std::size_t index(Index i) { return static_cast<std::size_t>(i); }

std::vector<int> with(std::vector<int> active, int row) {
  active.insert(std::lower_bound(active.begin(), active.end(), row), row);
  return active;
}

std::vector<int> without(std::vector<int> active, int row) {
  active.erase(std::find(active.begin(), active.end(), row));
  return active;
}

bool holds(const std::vector<int>& active, int row) {
  return std::binary_search(active.begin(), active.end(), row);
}

std::size_t position(const std::vector<int>& active, int row) {
  return static_cast<std::size_t>(std::lower_bound(active.begin(), active.end(), row) -
                                  active.begin());
}

std::string names(const std::vector<int>& active) {
  std::string text = "{";
  for (std::size_t i = 0; i < active.size(); ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(active[i]);
  }
  return text + "}";
}

// Unit plane −a·q + b ≥ 0 as (a, −b), from a condition; false if it is constant.
bool unit_plane(const double* form, int np, std::array<double, kMaxDimension + 1>& plane) {
  double norm = 0.0;
  for (int c = 0; c < np; ++c) norm += form[c] * form[c];
  norm = std::sqrt(norm);
  if (norm == 0.0) return false;
  for (int c = 0; c <= np; ++c) plane[index(c)] = -form[c] / norm;
  return true;
}

}  // namespace

std::size_t ActiveSetHash::operator()(const std::vector<int>& active) const {
  std::size_t hash = 1469598103934665603U;  // FNV-1a
  for (const int row : active) {
    hash ^= static_cast<std::size_t>(row) + 1U;
    hash *= 1099511628211U;
  }
  return hash;
}

FacetWalk::FacetWalk(const CertificateProblem& problem, const std::vector<CertifiedRegion>& regions,
                     const ActiveSetIndex& known)
    : problem_(problem),
      regions_(regions),
      index_(known),
      plane_(problem.parameters),
      cover_(problem, regions) {}

RegionCertifier& FacetWalk::certifier(int depth) {
  while (std::ssize(certifiers_) <= depth) {
    certifiers_.push_back(std::make_unique<RegionCertifier>(problem_));
  }
  return *certifiers_[index(depth)];
}

void FacetWalk::compare(const CertifiedRegion& from, const CertifiedRegion& to,
                        std::span<const double> plane, int row, int leaving,
                        std::span<const double> coefficients, FacetWalkResult& result) const {
  const int np = problem_.parameters;
  const std::size_t width = index(np + 1);
  // The plane as the other region has it: its condition `leaving` (a slack), or `row`.
  const int other = leaving >= 0 ? leaving : row;
  AffineForm form{};
  if (holds(to.independent, other)) {
    const double* lambda = to.lambda.data() + position(to.independent, other) * width;
    std::copy(lambda, lambda + width, form.begin());
  } else {
    form = certifiers_.front()->slack(to, other);
  }
  std::array<double, kMaxDimension + 1> seen{};
  if (!unit_plane(form.data(), np, seen)) {
    result.plane_mismatch = 2.0;
    return;
  }
  for (std::size_t c = 0; c < width; ++c) {
    result.plane_mismatch = std::max(result.plane_mismatch, std::abs(seen[c] + plane[c]));
  }
  const auto residual = [&](const auto& difference) {
    std::array<double, kMaxDimension + 1> values{};
    for (std::size_t c = 0; c < width; ++c) values[c] = difference(c);
    return FacetPlane::residual({values.data(), width}, plane);
  };
  double size = 1e-300;
  double worst = 0.0;
  for (std::size_t i = 0; i < from.z.size(); i += width) {
    for (std::size_t c = 0; c < width; ++c) {
      size = std::max({size, std::abs(from.z[i + c]), std::abs(to.z[i + c])});
    }
    worst = std::max(worst, residual([&](std::size_t c) { return to.z[i + c] - from.z[i + c]; }));
  }
  double lambda_size = 1e-300;
  double lambda_worst = 0.0;
  const double* entering = nullptr;  // multiplier of the row that came in for `leaving`
  if (leaving >= 0) entering = to.lambda.data() + position(to.independent, row) * width;
  for (std::size_t a = 0; a < from.independent.size(); ++a) {
    const int k = from.independent[a];
    if (!holds(to.independent, k)) continue;
    const double* mine = from.lambda.data() + a * width;
    const double* theirs = to.lambda.data() + position(to.independent, k) * width;
    const double share = entering != nullptr ? coefficients[a] : 0.0;
    for (std::size_t c = 0; c < width; ++c) {
      lambda_size = std::max({lambda_size, std::abs(mine[c]), std::abs(theirs[c])});
    }
    lambda_worst = std::max(lambda_worst, residual([&](std::size_t c) {
                              const double in = entering != nullptr ? share * entering[c] : 0.0;
                              return theirs[c] - mine[c] + in;
                            }));
  }
  if (worst > 0.0) result.law_mismatch = std::max(result.law_mismatch, worst / size);
  if (lambda_worst > 0.0) {
    result.law_mismatch = std::max(result.law_mismatch, lambda_worst / lambda_size);
  }
  result.jump =
      std::max(result.jump, residual([&](std::size_t c) { return to.output[c] - from.output[c]; }));
}

void FacetWalk::enter(const CertifiedRegion& from, int depth, const std::vector<int>& active,
                      int row, const long double* exit, const FacetPiece& piece,
                      FacetWalkResult& result) {
  const double radius = plane_.radius(piece);
  if (radius <= kSliver) {
    if (radius > 0.0) ++result.slivers;
    return;
  }
  FacetWalkResult before = result;
  pass(from, depth, active, row, piece, result);
  if (result.failure.empty()) return;
  if (take(cover_.cover(plane_, piece, origin_, from, exit), before)) result = std::move(before);
}

// Through a gap, to what lies beyond it.
void FacetWalk::pass(const CertifiedRegion& from, int depth, const std::vector<int>& active,
                     int row, const FacetPiece& piece, FacetWalkResult& result) {
  const std::string where =
      "across condition " + std::to_string(row) + " of the active set " + names(from.independent);
  CertifiedRegion gap;
  RegionCertifier& here = certifier(depth);
  if (!here.solve(active, gap) || gap.independent.size() != active.size()) {
    result.failure = "no active set fits " + where;
    return;
  }
  const ExtendedMatrix forms = here.forms();
  here.certify(active, 1.0, gap);
  if (gap.polytope.radius > kThickest || depth > kDeepest) {
    char text[80];
    std::snprintf(text, sizeof text,
                  "a hole that holds a ball of radius %.2g (of the half box) lies ",
                  gap.polytope.radius);
    result.failure =
        text + where + ": the region of the active set " + names(active) + " is not in the list";
    return;
  }
  result.gap_radius = std::max(result.gap_radius, gap.polytope.radius);
  // Heights t_k(x) = r_k(x)/fall at which the conditions vanish above the piece.
  const int np = problem_.parameters;
  std::vector<int> exits;
  std::vector<std::vector<long double>> heights;
  for (Index k = 0; k < forms.rows() + 2 * np; ++k) {
    std::vector<long double> form(index(np + 1));
    if (k < forms.rows()) {
      if (problem_.first_equal[index(k)] != k) continue;
      for (Index c = 0; c <= np; ++c) form[index(c)] = forms(k, c);
    } else {
      const Index side = k - forms.rows();
      form[index(side / 2)] = side % 2 == 0 ? -1.0L : 1.0L;
      form[index(np)] = 1.0L;
    }
    long double fall = 0.0L;
    long double scale = 0.0L;
    for (int j = 0; j < np; ++j) {
      fall -= form[index(j)] * plane_.normal(j);
      scale = std::max(scale, std::abs(form[index(j)]));
    }
    if (fall <= 1e-13L * scale) continue;
    for (long double& c : form) c /= fall;
    exits.push_back(k < forms.rows() ? static_cast<int>(k) : -1);
    heights.push_back(std::move(form));
  }
  bool left = false;
  for (std::size_t e = 0; e < exits.size(); ++e) {
    FacetPiece part = piece;
    for (std::size_t other = 0; other < exits.size() && !part.empty; ++other) {
      if (other == e) continue;
      std::vector<long double> difference(index(np + 1));
      for (std::size_t c = 0; c < difference.size(); ++c) {
        difference[c] = heights[other][c] - heights[e][c];
      }
      plane_.append(part, difference.data());
    }
    if (plane_.radius(part) <= kSliver) continue;
    left = true;
    if (exits[e] < 0) continue;  // the box ends here
    leave(gap, depth, exits[e], part, result);
    if (!result.failure.empty()) return;
  }
  if (!left) ++result.slivers;
  result.gaps.push_back(gap);
}

void FacetWalk::leave(const CertifiedRegion& from, int depth, int row, const FacetPiece& piece,
                      FacetWalkResult& result) {
  RegionCertifier& here = certifier(depth);
  const ExtendedMatrix forms = here.forms();
  const int np = problem_.parameters;
  std::array<double, kMaxDimension + 1> form{}, plane{};
  for (Index c = 0; c <= np; ++c) form[index(c)] = static_cast<double>(forms(row, c));
  if (!unit_plane(form.data(), np, plane)) {
    result.failure = "a condition that does not depend on the parameters was crossed";
    return;
  }
  const std::span<const double> seen(plane.data(), index(np + 1));
  const long double* exit = forms.row(row).data();
  std::vector<double> c;
  if (holds(from.independent, row) || !here.depends(row, &c)) {
    const std::vector<int> next =
        holds(from.independent, row) ? without(from.independent, row) : with(from.independent, row);
    const auto found = index_.find(next);
    if (found != index_.end()) {
      compare(from, regions_[index(found->second)], seen, row, -1, {}, result);
    } else {
      enter(from, depth + 1, next, row, exit, piece, result);
    }
    return;
  }
  std::vector<std::size_t> candidates;
  for (std::size_t i = 0; i < c.size(); ++i) {
    if (c[i] > kZero) candidates.push_back(i);
  }
  if (candidates.empty()) {
    if (result.kind != Kind::kFailed) result.kind = Kind::kInfeasible;
    return;
  }
  for (const std::size_t i : candidates) {
    const std::vector<int> next = with(without(from.independent, from.independent[i]), row);
    const auto found = index_.find(next);
    if (found != index_.end()) {
      compare(from, regions_[index(found->second)], seen, row, from.independent[i], c, result);
      continue;
    }
    FacetPiece part = piece;
    for (const std::size_t k : candidates) {
      if (k == i) continue;
      std::vector<long double> difference(index(np + 1));
      for (Index column = 0; column <= np; ++column) {
        difference[index(column)] =
            forms(from.independent[k], column) / static_cast<long double>(c[k]) -
            forms(from.independent[i], column) / static_cast<long double>(c[i]);
      }
      plane_.append(part, difference.data());
    }
    enter(from, depth + 1, next, row, exit, part, result);
    if (!result.failure.empty()) return;
  }
}

bool FacetWalk::take(const FacetCoverResult& cover, FacetWalkResult& result) {
  if (!cover.overlap.empty()) result.failure = cover.overlap;
  if (!cover.covered) return false;
  result.slivers += cover.slivers;
  result.plane_mismatch = std::max(result.plane_mismatch, cover.plane_mismatch);
  result.law_mismatch = std::max(result.law_mismatch, cover.law_mismatch);
  result.jump = std::max(result.jump, cover.jump);
  return true;
}

// The facet's plane and what the region's other conditions leave of it.
FacetPiece FacetWalk::open(int region, int facet) {
  const HalfSpaces& facets = regions_[index(region)].polytope.facets;
  const int np = problem_.parameters;
  Point normal{};
  facets.copy_normal(facet, normal.data());
  plane_.set(normal.data(), facets.offset(facet));
  FacetPiece piece = plane_.whole();
  std::vector<long double> form(index(np + 1));
  for (int i = 0; i < facets.size(); ++i) {
    if (i == facet) continue;
    for (int j = 0; j < np; ++j) form[index(j)] = -facets.normal(i, j);
    form[index(np)] = facets.offset(i);
    plane_.append(piece, form.data());
  }
  origin_ = region;
  return piece;
}

void FacetWalk::cross_unnamed(int region, int facet, FacetWalkResult& result) {
  const CertifiedRegion& from = regions_[index(region)];
  const int row = from.polytope.labels[index(facet)];
  if (solved_ != region) {
    certifier(0).solve(from.independent, first_);
    solved_ = region;
  }
  const FacetPiece piece = open(region, facet);
  result.kind = Kind::kWalked;
  std::vector<double> c;
  const bool exchange = !holds(from.independent, row) && certifier(0).depends(row, &c);
  const bool feasible =
      !exchange || std::any_of(c.begin(), c.end(), [](double x) { return x > kZero; });
  if (feasible) {
    const FacetCoverResult cover =
        cover_.cover(plane_, piece, region, from, certifier(0).forms().row(row).data());
    if (take(cover, result) || !result.failure.empty()) return;
  }
  leave(from, 0, row, piece, result);
}

FacetWalkResult FacetWalk::cross(int region, int facet) {
  const CertifiedRegion& from = regions_[index(region)];
  const HalfSpaces& facets = from.polytope.facets;
  const int np = problem_.parameters;
  FacetWalkResult result;
  const int row = from.polytope.labels[index(facet)];
  const bool active = holds(from.independent, row);
  const auto flip =
      index_.find(active ? without(from.independent, row) : with(from.independent, row));
  if (flip != index_.end() && from.coincident[index(facet)] == 0) {
    std::array<double, kMaxDimension + 1> plane{};
    facets.copy_normal(facet, plane.data());
    plane[index(np)] = -facets.offset(facet);
    result.kind = Kind::kMatched;
    certifier(0);
    compare(from, regions_[index(flip->second)], {plane.data(), index(np + 1)}, row, -1, {},
            result);
  } else {
    cross_unnamed(region, facet, result);
  }
  if (result.failure.empty() &&
      std::max({result.plane_mismatch, result.law_mismatch}) > kAgreement) {
    char text[120];
    std::snprintf(text, sizeof text,
                  "planes or laws differ by %.2g across condition %d of the active set ",
                  std::max(result.plane_mismatch, result.law_mismatch), row);
    result.failure = text + names(from.independent);
  }
  if (!result.failure.empty()) result.kind = Kind::kFailed;
  return result;
}

}  // namespace eampc::law_design
