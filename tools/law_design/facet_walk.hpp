// What lies beyond a facet of a region, followed through the active sets until it is a region of
// the list, the border of the box, or parameters without a solution.
//
// Leaving 𝒜 across the facet of condition j, the next active set is 𝒜 Δ {j}, or, if row j depends
// on the active ones, M_j = Σ c_i M_i, one of 𝒜 ∪ {j} \ {i} with c_i > 0: where λ_i/c_i is least
// (with no c_i > 0 the rows contradict each other beyond the facet, by Farkas' lemma). In the
// facet's plane both active sets have the same z, and one multiplier vector each, of the same set
// of multipliers; so their conditions coincide there up to rows that imply each other, which is
// checked by comparing coefficients.
//
// A facet in whose plane one condition alone vanishes, and whose next active set 𝒜 Δ {j} is listed,
// is settled by that. Rows that depend on each other give one solution several active sets: what
// lies beyond other facets is looked for by polytopes and laws first, see facet_cover.hpp, and then
// followed through active sets that are not listed. Each of these is a gap. It is crossed along the
// facet's normal: each point of the facet leaves it by the condition that vanishes first, so the
// facet falls into pieces, each with a next active set. A gap that holds a ball of radius
// kThickest, and beyond whose border none of the listed regions begins, is a hole.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "law_design/facet_cover.hpp"
#include "law_design/facet_plane.hpp"
#include "law_design/region_certificate.hpp"

namespace eampc::law_design {

struct ActiveSetHash {
  std::size_t operator()(const std::vector<int>& active) const;
};
/// Independent active set → region.
using ActiveSetIndex = std::unordered_map<std::vector<int>, int, ActiveSetHash>;

struct FacetWalkResult {
  enum class Kind { kMatched, kWalked, kInfeasible, kFailed };
  Kind kind = Kind::kFailed;
  std::string failure;          ///< what is wrong beyond the facet
  double plane_mismatch = 0.0;  ///< of unit planes that should be the same
  double law_mismatch = 0.0;    ///< of z and λ in the plane, of their size
  double jump = 0.0;            ///< of the output in the plane, of its range
  double gap_radius = 0.0;      ///< of the largest ball in a gap crossed
  long slivers = 0;  ///< pieces of facets left out: no ball of radius kSliver in the plane
  std::vector<CertifiedRegion> gaps;
};

class FacetWalk {
 public:
  static constexpr double kThickest = 2e-8;
  static constexpr double kSliver = FacetCover::kSliver;
  /// Planes and laws of two regions that meet must agree to this.
  static constexpr double kAgreement = 1e-6;

  FacetWalk(const CertificateProblem& problem, const std::vector<CertifiedRegion>& regions,
            const ActiveSetIndex& index);

  /// What lies beyond facet `facet` of a region.
  FacetWalkResult cross(int region, int facet);

  long lp_count() const { return plane_.lp_count(); }

 private:
  void leave(const CertifiedRegion& from, int depth, int row, const FacetPiece& piece,
             FacetWalkResult& result);
  void enter(const CertifiedRegion& from, int depth, const std::vector<int>& active, int row,
             const long double* exit, const FacetPiece& piece, FacetWalkResult& result);
  void pass(const CertifiedRegion& from, int depth, const std::vector<int>& active, int row,
            const FacetPiece& piece, FacetWalkResult& result);
  void compare(const CertifiedRegion& from, const CertifiedRegion& to,
               std::span<const double> plane, int row, int leaving,
               std::span<const double> coefficients, FacetWalkResult& result) const;
  FacetPiece open(int region, int facet);
  void cross_unnamed(int region, int facet, FacetWalkResult& result);
  static bool take(const FacetCoverResult& cover, FacetWalkResult& result);
  RegionCertifier& certifier(int depth);

  const CertificateProblem& problem_;
  const std::vector<CertifiedRegion>& regions_;
  const ActiveSetIndex& index_;
  int solved_ = -1;  // region whose conditions certifier(0) holds
  CertifiedRegion first_;
  std::vector<std::unique_ptr<RegionCertifier>> certifiers_;
  FacetPlane plane_;
  FacetCover cover_;
  int origin_ = -1;  // region whose facet is crossed
};

}  // namespace eampc::law_design
