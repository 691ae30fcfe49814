// A piece of a facet against the regions of the list on both sides of its plane, by their polytopes
// and laws alone.
//
// Where rows depend on each other one solution has several active sets, and which of them is listed
// on one side of a plane says nothing of which is listed on the other. So, where names do not lead
// across: the listed regions with a facet in the plane, seen from beyond, are taken off the piece
// one after the other. It is covered if no ball of radius kSliver is left, exactly once if what two
// of them share of it holds no such ball either, and from this side the only region is the one
// left.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "law_design/facet_plane.hpp"
#include "law_design/region_certificate.hpp"

namespace eampc::law_design {

struct FacetCoverResult {
  bool covered = false;
  std::string overlap;          ///< what is covered twice; empty: nothing
  double plane_mismatch = 0.0;  ///< of unit planes that count as the same
  double law_mismatch = 0.0;    ///< of z in the plane, of its size
  double jump = 0.0;            ///< of the output in the plane, of its range
  long slivers = 0;             ///< parts left out: no ball of radius kSliver in the plane
};

class FacetCover {
 public:
  static constexpr double kSliver = 1e-9;
  static constexpr double kSame = CertifiedRegion::kSamePlane;

  FacetCover(const CertificateProblem& problem, const std::vector<CertifiedRegion>& regions)
      : problem_(problem), regions_(regions) {}

  /// The piece of `plane` through which region `origin` is left, at last by the condition `exit`
  /// (≥ 0 on this side; above the plane where gaps are between), where the law is that of `from`.
  FacetCoverResult cover(FacetPlane& plane, const FacetPiece& piece, int origin,
                         const CertifiedRegion& from, const long double* exit) const;

 private:
  struct Facet {
    int region = -1, facet = -1;
    double difference = 0.0;
  };
  std::vector<Facet> facets_in(const std::array<double, kMaxDimension + 1>& plane) const;
  void intersect(FacetPlane& plane, FacetPiece& piece, const Facet& facet,
                 const long double* exit) const;
  void compare(const CertifiedRegion& from, const CertifiedRegion& to,
               std::span<const double> plane, FacetCoverResult& result) const;

  const CertificateProblem& problem_;
  const std::vector<CertifiedRegion>& regions_;
};

}  // namespace eampc::law_design
