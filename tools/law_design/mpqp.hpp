// Explicit solution of a strictly convex multiparametric quadratic program,
//   min over U of ½UᵀHU + (F p + f)ᵀU  subject to  G U ≤ w + S p,  lower ≤ p ≤ upper,
// as critical regions: polytopes of p on each of which the active set is fixed and U is affine
// (Bemporad, Morari, Dua, Pistikopoulos, Automatica 38, 2002).
//
// Explored by crossing facets; see region_explorer.hpp for how and region_builder.hpp for what
// keeps regions from overlapping.
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include "law_design/region_location.hpp"

namespace eampc::law_design {

struct MpQp {
  Eigen::MatrixXd H;             ///< n×n, positive definite
  Eigen::MatrixXd F;             ///< n×np
  Eigen::VectorXd f;             ///< n
  Eigen::MatrixXd G;             ///< m×n
  Eigen::VectorXd w;             ///< m
  Eigen::MatrixXd S;             ///< m×np
  Eigen::VectorXd lower, upper;  ///< np, finite, lower < upper
};

/// The number a law puts out: y = clip(Y_U·U(p) + Y_p·p + y_0, y_min, y_max).
struct OutputLaw {
  Eigen::RowVectorXd Y_U;  ///< n
  Eigen::RowVectorXd Y_p;  ///< np
  double y_0 = 0.0;
  double y_min = 0.0, y_max = 0.0;
};

struct CriticalRegion {
  std::vector<int> active_set;  ///< rows of the problem as given, ascending
  Eigen::MatrixXd gain;         ///< U(p) = gain·p + offset, n×np
  Eigen::VectorXd offset;       ///< n
  Eigen::MatrixXd facet_normals;  ///< k×np, unit rows: facet_normals·p ≤ facet_offsets, irredundant
  Eigen::VectorXd facet_offsets;       ///< k
  std::vector<FacetKind> facet_kinds;  ///< k
  /// Regions across each facet; empty unless FacetKind::kInner.
  std::vector<std::vector<int>> neighbours;
  Eigen::VectorXd interior;  ///< centre of the largest ball in the box scaled to ±1
  double radius = 0.0;       ///< of that ball, in the same scale
};

struct MpQpStatistics {
  int rows_given = 0;
  int rows_kept = 0;  ///< after dropping redundant and parameter-only rows
  int regions = 0;
  long lps = 0;
  long qps = 0;
  long flat_active_sets = 0;      ///< optimal only on a set without volume: walked through
  long degenerate_fallbacks = 0;  ///< crossings that led through such a set
  long infeasible_facets = 0;     ///< facets of the feasible set's border, inside the box
  long stepped_facets = 0;        ///< facets beyond which rounding hid the active set
  long flat_regions_dropped = 0;  ///< slivers left out because a neighbour's solution is as good …
  double largest_jump = 0.0;      ///< … to this share of the largest solution, at most 1e-6
  long thin_regions = 0;          ///< kept though their radius is below 1e-10
  long saturated_active_sets = 0;  ///< left out because of MpQpOptions::output
  long random_points = 0;          ///< points checked beside the facets …
  long closure_misses = 0;         ///< … that lay outside all regions known then (now covered)
  long infeasible_points = 0;      ///< … that have no solution
  long unresolved_points = 0;      ///< points neither covered nor infeasible: 0 in a valid solution
  double seconds = 0.0;
};

struct MpQpOptions {
  /// If given, regions whose output sits on one of its bounds throughout are found but neither
  /// returned nor crossed. A law structure needs them all. What this cannot
  /// prove is that the rest of the parameters hangs together: a part with an unsaturated output
  /// that is surrounded by saturated ones is found only if a random point falls into it.
  std::optional<OutputLaw> output;
  int random_points = 2000;
  unsigned seed = 1;
  /// More regions than this are an error: the law would be too large to use.
  int max_regions = 200000;
  int threads = 0;  ///< 0: one per core. The solution does not depend on it.
  double time_limit_s = std::numeric_limits<double>::infinity();
  /// Called now and then, by the calling thread only, with (regions explored, regions found); false
  /// cancels.
  std::function<bool(int, int)> progress;
};

struct MpQpSolution {
  std::vector<CriticalRegion> regions;
  Eigen::VectorXd lower, upper;
  MpQpStatistics statistics;
  /// Some parameters of the box have no solution.
  bool has_infeasible_parameters = false;
};

struct Cancelled : std::runtime_error {
  Cancelled() : std::runtime_error("cancelled by the caller") {}
};

/// MpQpOptions::time_limit_s is over.
struct TimeLimit : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Solves the problem. Throws std::invalid_argument for a problem that is not strictly convex, has
/// inconsistent shapes or no feasible parameter; TimeLimit; std::runtime_error if the regions
/// cannot be proved to cover the feasible parameters; Cancelled if `progress` returned false.
MpQpSolution solve_mpqp(const MpQp& problem, const MpQpOptions& options = {});

}  // namespace eampc::law_design
