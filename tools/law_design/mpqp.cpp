#include "law_design/mpqp.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <sstream>
#include <string>

#include "law_design/least_distance_form.hpp"
#include "law_design/linear_program.hpp"
#include "law_design/region_explorer.hpp"

namespace eampc::law_design {
namespace {

const Eigen::IOFormat kOneLine(6, Eigen::DontAlignCols, ", ", ", ");

CriticalRegion in_problem_units(const LeastDistanceForm& form, const ExploredRegion& explored) {
  const Eigen::Index np = form.parameters;
  CriticalRegion region;
  for (const int row : explored.active) {
    region.active_set.push_back(form.original_rows[static_cast<std::size_t>(row)]);
  }
  std::sort(region.active_set.begin(), region.active_set.end());
  const Eigen::MatrixXd u = form.back * explored.z + form.shift;
  region.gain = u.leftCols(np) * form.half_width.cwiseInverse().asDiagonal();
  region.offset = u.col(np) - region.gain * form.centre;
  const HalfSpaces& facets = explored.polytope.facets;
  region.facet_normals.resize(facets.size(), np);
  region.facet_offsets.resize(facets.size());
  for (int i = 0; i < facets.size(); ++i) {
    for (int j = 0; j < form.parameters; ++j) {
      region.facet_normals(i, j) = facets.normal(i, j) / form.half_width(j);
    }
    const double norm = region.facet_normals.row(i).norm();
    region.facet_normals.row(i) /= norm;
    region.facet_offsets(i) =
        facets.offset(i) / norm + region.facet_normals.row(i).dot(form.centre);
  }
  region.facet_kinds = explored.facet_kinds;
  region.neighbours = explored.neighbours;
  const Eigen::Map<const Eigen::VectorXd> centre(explored.polytope.centre.data(), np);
  region.interior = form.centre + centre.cwiseProduct(form.half_width);
  region.radius = explored.polytope.radius;
  return region;
}

// Rows were reduced within |z_j| ≤ z_bound; the reduction is right if every region's law stays
// inside (then the law is feasible, hence optimal, for the rows that were dropped).
void check_z_bound(const LeastDistanceForm& form, const std::vector<ExploredRegion>& regions) {
  if (form.z_bound_proved) return;
  LinearProgram program(form.parameters);
  for (const ExploredRegion& region : regions) {
    for (int j = 0; j < form.variables; ++j) {
      if (region.z.row(j).lpNorm<1>() <= form.z_bound) continue;
      const double offset = region.z(j, form.parameters);
      for (const double sign : {1.0, -1.0}) {
        const LeastDistanceForm::RowMatrix c = sign * region.z.row(j).head(form.parameters);
        const LpResult result =
            program.maximise(c.data(), region.polytope.facets, form.z_bound - sign * offset);
        if (result.status == LpStatus::kBelowCutoff || result.status == LpStatus::kInfeasible) {
          continue;
        }
        throw std::runtime_error(
            "mpQP: the optimal solution grows far beyond the values sampled when redundant rows "
            "were dropped; scale the problem or bound its parameters more tightly");
      }
    }
  }
}

}  // namespace

MpQpSolution solve_mpqp(const MpQp& problem, const MpQpOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  const LeastDistanceForm form = to_least_distance_form(problem);
  RegionExplorer explorer(form, options, start);
  explorer.run();
  check_z_bound(form, explorer.regions());

  MpQpSolution solution;
  solution.lower = problem.lower;
  solution.upper = problem.upper;
  solution.statistics = explorer.statistics();
  MpQpStatistics& statistics = solution.statistics;
  statistics.rows_given = static_cast<int>(problem.G.rows());
  statistics.rows_kept = static_cast<int>(form.rows.rows());
  statistics.lps += form.lps;
  statistics.qps += form.qps;
  solution.has_infeasible_parameters = statistics.infeasible_facets > 0 ||
                                       statistics.infeasible_points > 0 ||
                                       form.parameter_rows.size() > 0;
  for (const ExploredRegion& region : explorer.regions()) {
    solution.regions.push_back(in_problem_units(form, region));
  }
  statistics.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (statistics.unresolved_points > 0) {
    const Eigen::Map<const Eigen::VectorXd> q(explorer.unresolved_at().data(), form.parameters);
    std::ostringstream where;
    where << (form.centre + q.cwiseProduct(form.half_width)).transpose().format(kOneLine);
    std::ostringstream why;
    if (std::isfinite(explorer.unresolved_jump())) {
      why << " (the nearest region's solution is off by " << explorer.unresolved_jump()
          << " of the largest)";
    }
    throw std::runtime_error(
        "mpQP: at " + std::to_string(statistics.unresolved_points) + " points, the first p = (" +
        where.str() + "), rounding hides which rows are active" + why.str() +
        ", so the regions cannot be proved to "
        "cover every parameter; scale the problem, or drop rows that nearly depend on each other");
  }
  return solution;
}

}  // namespace eampc::law_design
