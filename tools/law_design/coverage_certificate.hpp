// Coverage without hole or overlap, from the facets, and continuity of the law across them.
//
// Let c(q) be the number of regions that hold q. Along a path in the box that meets facets only at
// generic points (each in one plane, on no lower face), c changes only where the path crosses a
// facet, by the facets that end there against those that begin. So if on every plane each facet
// is covered, almost everywhere and exactly once, by facets of regions on the other side, then c
// is the same at every generic point of the box, and one generic point held by exactly one region
// proves c = 1: the regions tile the box. (Covered at least once suffices for no hole.)
//
// Each facet belongs to one condition j of its region's active set 𝒜. With 𝒜' = 𝒜 Δ {j} in the
// list, the two laws agree on the facet's plane: z' − z and λ' − λ are multiples of the plane's
// form. Then all other conditions of both regions coincide in that plane, so both facets are the
// same polytope, met from both sides: a match without a linear program, checked by comparing
// coefficients. Dependent rows, several conditions that vanish in one plane, and flat regions that
// the list leaves out: see facet_walk.hpp and facet_cover.hpp. The flat ones found there are gaps:
// the law is checked on them like on the regions.
#pragma once

#include <string>
#include <vector>

#include "law_design/certificate_problem.hpp"
#include "law_design/parallel_range.hpp"
#include "law_design/region_certificate.hpp"

namespace eampc::law_design {

struct CoverageOptions {
  bool infeasible_allowed = false;  ///< facets may border parameters proved to have no solution
  int generic_points = 20;
  unsigned seed = 1;
  int threads = 1;
};

struct CoverageCertificate {
  bool proved = false;
  std::string failure;  ///< one sentence: what is wrong, where; empty if proved

  long facets = 0;             ///< not on the border of the box
  long matched = 0;            ///< by their active sets
  long walked = 0;             ///< by polytopes and laws, or through dependent rows or gaps
  long infeasible_border = 0;  ///< proved by Farkas' lemma
  long uncovered = 0;
  long duplicates = 0;          ///< active sets listed twice
  double plane_mismatch = 0.0;  ///< largest difference of the planes of two matched facets
  double law_mismatch = 0.0;    ///< … of z and λ on it, of their size
  double jump = 0.0;            ///< … of the output on it, of its range
  double largest_gap = 0.0;     ///< radius of the largest ball in a gap of the list
  long slivers = 0;             ///< pieces of facets left out, see FacetWalk::kSliver
  int generic_points = 0;       ///< each held by exactly one region
  double volume = -1.0;         ///< of all regions over the box's, if np ≤ 3; else negative
  long lps = 0;
  /// Flat regions found between the listed ones: the law is checked on them like on the others.
  std::vector<CertifiedRegion> gap_regions;
};

CoverageCertificate certify_coverage(const CertificateProblem& problem,
                                     const std::vector<CertifiedRegion>& regions,
                                     const CoverageOptions& options,
                                     const LoopProgress& progress = {});

}  // namespace eampc::law_design
