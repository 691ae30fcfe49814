// Optimality, region by region, from the active set alone.
//
// An active set 𝒜 of independent rows gives z = −M_𝒜ᵀ λ, M_𝒜 z = D_𝒜 (q, 1): U(q) and λ(q) are
// affine. Where λ ≥ 0 and G U ≤ W (q, 1), U(q) satisfies the Karush-Kuhn-Tucker conditions; the
// problem is strictly convex (H is positive definite), so U(q) is the optimum there and the only
// one. Both residuals, of the stationarity and of the active rows, are affine in q: the sum of the
// absolute coefficients bounds them on the whole box, not only at chosen points. The inactive rows
// and the signs of λ are the polytope's facets, or redundant by a linear program.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "law_design/certificate_problem.hpp"
#include "law_design/parallel_range.hpp"
#include "law_design/region_polytope.hpp"

namespace eampc::law_design {

/// c[0..np)·q + c[np].
using AffineForm = std::array<double, kMaxDimension + 1>;

struct CertifiedRegion {
  /// Unit planes that differ by less are the same.
  static constexpr double kSamePlane = 1e-10;

  std::vector<int> active;       ///< rows of the problem as given, ascending
  std::vector<int> independent;  ///< a largest independent subset: the rows with multipliers
  std::vector<double> z;         ///< n×(np+1)
  std::vector<double> lambda;    ///< of the independent rows, k×(np+1), for unit rows M
  AffineForm output{};           ///< y, not clipped
  RegionPolytope polytope;       ///< labels are rows of the problem
  std::vector<char> coincident;  ///< per facet: another condition vanishes in its plane
  double stationarity = 0.0;     ///< largest residual of H U + F + Gᵀλ, of the size of its terms
  double primal = 0.0;           ///< of an active row, as a distance in z, of z's size
  bool solved = false;           ///< polytope and law are meaningful
};

class RegionCertifier {
 public:
  explicit RegionCertifier(const CertificateProblem& problem);

  /// Law, residuals and polytope of an active set. False if it is empty (region.polytope.radius
  /// tells) or a row is not in the problem. Below `least_radius` the facets are left out.
  bool certify(const std::vector<int>& active, double least_radius, CertifiedRegion& region);

  /// The law alone: z, λ, y, residuals, and `forms()`.
  bool solve(const std::vector<int>& active, CertifiedRegion& region);
  /// After solve(): row i's condition as forms().row(i)·(q, 1) ≥ 0, which is the multiplier for
  /// the independent rows and the slack for the others.
  const ExtendedMatrix& forms() const { return forms_; }
  /// After solve(): y as np + 1 coefficients.
  const std::vector<long double>& output() const { return output_; }
  /// Coefficients of M_row in the independent rows after solve(); true if it depends on them.
  bool depends(int row, std::vector<double>* coefficients) const;
  /// The slack of a row under a region's z.
  AffineForm slack(const CertifiedRegion& region, int row) const;

  long lp_count() const { return maker_.lp_count(); }

 private:
  bool append(int row);
  void mark_coincident(CertifiedRegion& region) const;

  const CertificateProblem& problem_;
  RegionPolytopeMaker maker_;
  ExtendedMatrix q_, r_;  // rows of q_: orthonormal basis of the active rows; M_𝒜ᵀ = q_ᵀ r_
  int size_ = 0;
  ExtendedMatrix forms_;
  std::vector<long double> scales_, output_;
  HalfSpaces rows_;
  std::vector<int> labels_;
};

struct RegionsCertificate {
  std::vector<CertifiedRegion> regions;
  double stationarity = 0.0, primal = 0.0;  ///< worst of all regions
  double least_radius = 0.0;
  int flat = 0;   ///< regions with a radius below 1e-8
  int empty = 0;  ///< active sets without any region: 0 in a proved law
  int first_empty = -1;
  long lps = 0;
};

/// Certifies every active set.
RegionsCertificate certify_regions(const CertificateProblem& problem,
                                   const std::vector<std::vector<int>>& active_sets, int threads,
                                   const LoopProgress& progress = {});

}  // namespace eampc::law_design
