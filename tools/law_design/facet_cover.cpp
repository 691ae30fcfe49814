#include "law_design/facet_cover.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace eampc::law_design {
namespace {

using Unit = std::array<double, kMaxDimension + 1>;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

// The condition of a facet, or what lies beyond it.
std::array<long double, kMaxDimension + 1> condition(const HalfSpaces& facets, int facet,
                                                     bool beyond) {
  std::array<long double, kMaxDimension + 1> form{};
  const int np = facets.dimension();
  const long double sign = beyond ? 1.0L : -1.0L;
  for (int j = 0; j < np; ++j) form[index(j)] = sign * facets.normal(facet, j);
  form[index(np)] = -sign * facets.offset(facet);
  return form;
}

}  // namespace

// Facets whose condition is this one, as unit coefficients of (q, 1) ≥ 0.
std::vector<FacetCover::Facet> FacetCover::facets_in(const Unit& plane) const {
  std::vector<Facet> found;
  const int np = problem_.parameters;
  for (std::size_t r = 0; r < regions_.size(); ++r) {
    if (!regions_[r].solved) continue;
    const HalfSpaces& facets = regions_[r].polytope.facets;
    for (int f = 0; f < facets.size(); ++f) {
      double difference = std::abs(facets.offset(f) - plane[index(np)]);
      for (int j = 0; j < np && difference <= kSame; ++j) {
        difference = std::max(difference, std::abs(facets.normal(f, j) + plane[index(j)]));
      }
      if (difference <= kSame) found.push_back({static_cast<int>(r), f, difference});
    }
  }
  return found;
}

void FacetCover::intersect(FacetPlane& plane, FacetPiece& piece, const Facet& facet,
                           const long double* exit) const {
  const HalfSpaces& facets = regions_[index(facet.region)].polytope.facets;
  for (int f = 0; f < facets.size() && !piece.empty; ++f) {
    if (f != facet.facet) plane.append_above(piece, condition(facets, f, false).data(), exit);
  }
}

void FacetCover::compare(const CertifiedRegion& from, const CertifiedRegion& to,
                         std::span<const double> plane, FacetCoverResult& result) const {
  const std::size_t width = plane.size();
  Unit difference{};
  const std::span<const double> seen(difference.data(), width);
  double size = 1e-300;
  double worst = 0.0;
  for (std::size_t i = 0; i < from.z.size(); i += width) {
    for (std::size_t c = 0; c < width; ++c) {
      size = std::max({size, std::abs(from.z[i + c]), std::abs(to.z[i + c])});
      difference[c] = to.z[i + c] - from.z[i + c];
    }
    worst = std::max(worst, FacetPlane::residual(seen, plane));
  }
  result.law_mismatch = std::max(result.law_mismatch, worst / size);
  for (std::size_t c = 0; c < width; ++c) difference[c] = to.output[c] - from.output[c];
  result.jump = std::max(result.jump, FacetPlane::residual(seen, plane));
}

FacetCoverResult FacetCover::cover(FacetPlane& plane, const FacetPiece& piece, int origin,
                                   const CertifiedRegion& from, const long double* exit) const {
  FacetCoverResult result;
  const int np = problem_.parameters;
  long double norm = 0.0L;
  for (int j = 0; j < np; ++j) norm += exit[j] * exit[j];
  norm = std::sqrt(norm);
  if (norm == 0.0L) return result;
  Unit inside{}, beyond{};
  for (int c = 0; c <= np; ++c) {
    inside[index(c)] = static_cast<double>(exit[c] / norm);
    beyond[index(c)] = -inside[index(c)];
  }
  for (const Facet& facet : facets_in(inside)) {
    if (facet.region == origin) continue;
    FacetPiece shared = piece;
    intersect(plane, shared, facet, exit);
    if (plane.radius(shared) <= kSliver) continue;
    result.overlap = "regions " + std::to_string(origin) + " and " + std::to_string(facet.region) +
                     " of the list overlap";
    return result;
  }
  std::vector<FacetPiece> rest = {piece};
  std::vector<std::pair<int, FacetPiece>> taken;
  for (const Facet& facet : facets_in(beyond)) {
    const CertifiedRegion& to = regions_[index(facet.region)];
    FacetPiece shared = piece;
    intersect(plane, shared, facet, exit);
    if (plane.radius(shared) <= kSliver) continue;
    for (const auto& [other, part] : taken) {
      FacetPiece both = part;
      intersect(plane, both, facet, exit);
      if (plane.radius(both) <= kSliver) continue;
      result.overlap = "regions " + std::to_string(other) + " and " + std::to_string(facet.region) +
                       " of the list overlap";
      return result;
    }
    taken.emplace_back(facet.region, std::move(shared));
    result.plane_mismatch = std::max(result.plane_mismatch, facet.difference);
    compare(from, to, {inside.data(), index(np + 1)}, result);
    // What one facet leaves of a piece: beyond its first condition; within it, beyond the second …
    std::vector<FacetPiece> left;
    for (FacetPiece& part : rest) {
      const HalfSpaces& facets = to.polytope.facets;
      for (int f = 0; f < facets.size() && !part.empty; ++f) {
        if (f == facet.facet) continue;
        FacetPiece outside = part;
        plane.append_above(outside, condition(facets, f, true).data(), exit);
        const double radius = plane.radius(outside);
        if (radius > kSliver) {
          left.push_back(std::move(outside));
        } else if (radius > 0.0) {
          ++result.slivers;
        }
        plane.append_above(part, condition(facets, f, false).data(), exit);
      }
    }
    rest = std::move(left);
  }
  result.covered = rest.empty() || plane.radius(piece) <= kSliver;
  return result;
}

}  // namespace eampc::law_design
