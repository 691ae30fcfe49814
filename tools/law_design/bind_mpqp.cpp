// Python binding of the multiparametric QP solver.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <Eigen/Dense>
#include <cstdint>
#include <optional>
#include <utility>

#include "law_design/bind_arrays.hpp"
#include "law_design/mpqp.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

nb::dict statistics(const MpQpStatistics& s) {
  nb::dict d;
  d["rows_given"] = s.rows_given;
  d["rows_kept"] = s.rows_kept;
  d["regions"] = s.regions;
  d["lps"] = s.lps;
  d["qps"] = s.qps;
  d["degenerate_fallbacks"] = s.degenerate_fallbacks;
  d["closure_points"] = s.closure_points;
  d["closure_misses"] = s.closure_misses;
  d["flat_regions_dropped"] = s.flat_regions_dropped;
  d["saturated_active_sets"] = s.saturated_active_sets;
  d["infeasible_points"] = s.infeasible_points;
  d["seconds"] = s.seconds;
  return d;
}

MpQpSolution solve(const Matrix& H, const Matrix& F, const Vector& f, const Matrix& G,
                   const Vector& w, const Matrix& S, const Vector& lower, const Vector& upper,
                   const nb::object& progress, int closure_points_per_facet, int random_points,
                   unsigned seed, const std::optional<OutputLaw>& output, int max_regions) {
  const MpQp problem{matrix(H), matrix(F), vector(f),     matrix(G),
                     vector(w), matrix(S), vector(lower), vector(upper)};
  std::exception_ptr raised;
  MpQpOptions options;
  options.closure_points_per_facet = closure_points_per_facet;
  options.random_points = random_points;
  options.seed = seed;
  options.max_regions = max_regions;
  options.output = output;
  options.progress = progress_function(progress, raised);
  try {
    nb::gil_scoped_release release;
    return solve_mpqp(problem, options);
  } catch (const Cancelled&) {
    if (raised) std::rethrow_exception(raised);
    throw;
  }
}

}  // namespace

void bind_mpqp(nb::module_& m) {
  nb::exception<Cancelled>(m, "Cancelled");

  nb::class_<CriticalRegion>(m, "CriticalRegion",
                             "Polytope of parameters on which the active set is fixed.")
      .def_ro("active_set", &CriticalRegion::active_set, "Active rows of the problem as given.")
      .def_prop_ro(
          "gain", [](const CriticalRegion& r) { return array(r.gain); }, nb::rv_policy::automatic,
          "(n, np): U(p) = gain @ p + offset.")
      .def_prop_ro(
          "offset", [](const CriticalRegion& r) { return array(r.offset); },
          nb::rv_policy::automatic, "(n,).")
      .def_prop_ro(
          "facet_normals", [](const CriticalRegion& r) { return array(r.facet_normals); },
          nb::rv_policy::automatic,
          "(k, np): the region is facet_normals @ p <= facet_offsets; unit rows.")
      .def_prop_ro(
          "facet_offsets", [](const CriticalRegion& r) { return array(r.facet_offsets); },
          nb::rv_policy::automatic, "(k,).")
      .def_ro("neighbours", &CriticalRegion::neighbours, "Regions met across each facet.")
      .def_prop_ro(
          "interior", [](const CriticalRegion& r) { return array(r.interior); },
          nb::rv_policy::automatic, "(np,): centre of the largest ball in the box scaled to +-1.")
      .def_ro("radius", &CriticalRegion::radius, "Radius of that ball, in the same scale.");

  nb::class_<OutputLaw>(m, "OutputLaw", "y = clip(Y_U @ U(p) + Y_p @ p + y_0, y_min, y_max).")
      .def(
          "__init__",
          [](OutputLaw* self, const Vector& Y_U, const Vector& Y_p, double y_0, double y_min,
             double y_max) {
            new (self)
                OutputLaw{vector(Y_U).transpose(), vector(Y_p).transpose(), y_0, y_min, y_max};
          },
          "Y_U"_a, "Y_p"_a, "y_0"_a, "y_min"_a, "y_max"_a, "Y_U (n,), Y_p (np,).");

  nb::class_<MpQpSolution>(m, "MpqpSolution", "Critical regions of a multiparametric QP.")
      .def_ro("regions", &MpQpSolution::regions, nb::rv_policy::reference_internal)
      .def_ro("has_infeasible_parameters", &MpQpSolution::has_infeasible_parameters)
      .def_prop_ro("statistics", [](const MpQpSolution& s) { return statistics(s.statistics); })
      .def("__len__", [](const MpQpSolution& s) { return s.regions.size(); });

  m.def("solve_mpqp", &solve, "H"_a, "F"_a, "f"_a, "G"_a, "w"_a, "S"_a, "lower"_a, "upper"_a,
        "progress"_a = nb::none(), "closure_points_per_facet"_a = 0, "random_points"_a = 2000,
        "seed"_a = 1U, "output"_a = nb::none(), "max_regions"_a = 200000,
        "Solve min over U of U'HU/2 + (F p + f)'U subject to G U <= w + S p for every p with\n"
        "lower <= p <= upper.\n\n"
        "Shapes, C-contiguous float64: H (n, n) positive definite, F (n, np), f (n,), G (m, n),\n"
        "w (m,), S (m, np), lower and upper (np,), np <= 8.\n"
        "progress(explored, found) is called now and then; returning False cancels.\n"
        "Raises ValueError for a problem that cannot be solved, RuntimeError if coverage cannot\n"
        "be reached, Cancelled.");
}

}  // namespace eampc::law_design
