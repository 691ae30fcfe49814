// Python binding of the multiparametric QP solver.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <Eigen/Dense>
#include <cstdint>
#include <limits>
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
  d["flat_active_sets"] = s.flat_active_sets;
  d["degenerate_fallbacks"] = s.degenerate_fallbacks;
  d["infeasible_facets"] = s.infeasible_facets;
  d["stepped_facets"] = s.stepped_facets;
  d["flat_regions_dropped"] = s.flat_regions_dropped;
  d["largest_jump"] = s.largest_jump;
  d["thin_regions"] = s.thin_regions;
  d["saturated_active_sets"] = s.saturated_active_sets;
  d["random_points"] = s.random_points;
  d["closure_misses"] = s.closure_misses;
  d["infeasible_points"] = s.infeasible_points;
  d["seconds"] = s.seconds;
  return d;
}

MpQpSolution solve(const Matrix& H, const Matrix& F, const Vector& f, const Matrix& G,
                   const Vector& w, const Matrix& S, const Vector& lower, const Vector& upper,
                   const nb::object& progress, int random_points, unsigned seed,
                   const std::optional<OutputLaw>& output, int max_regions, int threads,
                   double time_limit_s) {
  const MpQp problem{matrix(H), matrix(F), vector(f),     matrix(G),
                     vector(w), matrix(S), vector(lower), vector(upper)};
  std::exception_ptr raised;
  MpQpOptions options;
  options.random_points = random_points;
  options.seed = seed;
  options.max_regions = max_regions;
  options.output = output;
  options.threads = threads;
  options.time_limit_s = time_limit_s;
  options.progress = progress_function(progress, raised);
  try {
    nb::gil_scoped_release release;
    return solve_mpqp(problem, options);
  } catch (const Cancelled&) {
    if (raised) std::rethrow_exception(raised);
    throw;
  }
}

nb::dict region_arrays(const MpQpSolution& solution) {
  const auto np = static_cast<std::size_t>(solution.lower.size());
  const std::size_t count = solution.regions.size();
  const std::size_t n =
      count == 0 ? 0 : static_cast<std::size_t>(solution.regions.front().offset.size());
  std::vector<std::int64_t> facet_first{0}, neighbour_first{0}, active_first{0};
  std::vector<std::int32_t> neighbours, active_rows;
  std::vector<std::int8_t> kinds;
  std::vector<double> normals, offsets, gains, gain_offsets, interiors, radii;
  const auto append = [](std::vector<double>& to, const RowMajor& from) {
    to.insert(to.end(), from.data(), from.data() + from.size());
  };
  gains.reserve(count * n * np);
  for (const CriticalRegion& region : solution.regions) {
    active_rows.insert(active_rows.end(), region.active_set.begin(), region.active_set.end());
    active_first.push_back(static_cast<std::int64_t>(active_rows.size()));
    append(gains, region.gain);
    append(gain_offsets, region.offset);
    append(normals, region.facet_normals);
    append(offsets, region.facet_offsets);
    append(interiors, region.interior);
    radii.push_back(region.radius);
    for (const FacetKind kind : region.facet_kinds) kinds.push_back(static_cast<std::int8_t>(kind));
    for (const std::vector<int>& list : region.neighbours) {
      neighbours.insert(neighbours.end(), list.begin(), list.end());
      neighbour_first.push_back(static_cast<std::int64_t>(neighbours.size()));
    }
    facet_first.push_back(static_cast<std::int64_t>(kinds.size()));
  }
  const auto column = [](auto values) {
    const std::size_t size = values.size();
    return nb::cast(array(std::move(values), {size}));
  };
  nb::dict d;
  const std::size_t facets = kinds.size();
  d["active_first"] = column(std::move(active_first));
  d["active_rows"] = column(std::move(active_rows));
  d["gain"] = nb::cast(array(std::move(gains), {count, n, np}));
  d["offset"] = nb::cast(array(std::move(gain_offsets), {count, n}));
  d["facet_first"] = column(std::move(facet_first));
  d["facet_normals"] = nb::cast(array(std::move(normals), {facets, np}));
  d["facet_offsets"] = column(std::move(offsets));
  d["facet_kinds"] = column(std::move(kinds));
  d["neighbour_first"] = column(std::move(neighbour_first));
  d["neighbours"] = column(std::move(neighbours));
  d["interior"] = nb::cast(array(std::move(interiors), {count, np}));
  d["radius"] = column(std::move(radii));
  return d;
}

template <typename T>
using Column = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

nb::ndarray<nb::numpy, std::int32_t> locate_regions(const Column<std::int64_t>& facet_first,
                                                    const Matrix& normals, const Vector& offsets,
                                                    const Column<std::int8_t>& kinds,
                                                    const Column<std::int64_t>& neighbour_first,
                                                    const Column<std::int32_t>& neighbours,
                                                    const Matrix& p, double tolerance) {
  const RegionArrays arrays{
      static_cast<int>(normals.shape(1)),    {facet_first.data(), facet_first.size()},
      {normals.data(), normals.size()},      {offsets.data(), offsets.size()},
      {kinds.data(), kinds.size()},          {neighbour_first.data(), neighbour_first.size()},
      {neighbours.data(), neighbours.size()}};
  if (!arrays.valid() || p.shape(1) != normals.shape(1)) {
    throw nb::value_error("locate_regions: the arrays do not fit together");
  }
  std::vector<std::int32_t> found(p.shape(0), -1);
  {
    nb::gil_scoped_release release;
    int start = 0;
    for (std::size_t i = 0; i < found.size() && arrays.regions() > 0; ++i) {
      found[i] = locate(arrays, p.data() + i * p.shape(1), start, tolerance);
      if (found[i] >= 0) start = found[i];
    }
  }
  const std::size_t count = found.size();
  return array(std::move(found), {count});
}

}  // namespace

void bind_mpqp(nb::module_& m) {
  nb::exception<Cancelled>(m, "Cancelled");
  nb::exception<TimeLimit>(m, "TimeLimit", PyExc_RuntimeError);

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
      .def("arrays", &region_arrays, "All regions as a dict of flat arrays; see eampc.mpqp.")
      .def("__len__", [](const MpQpSolution& s) { return s.regions.size(); });

  m.def("solve_mpqp", &solve, "H"_a, "F"_a, "f"_a, "G"_a, "w"_a, "S"_a, "lower"_a, "upper"_a,
        "progress"_a = nb::none(), "random_points"_a = 2000, "seed"_a = 1U, "output"_a = nb::none(),
        "max_regions"_a = 200000, "threads"_a = 0,
        "time_limit_s"_a = std::numeric_limits<double>::infinity(),
        "Solve min over U of U'HU/2 + (F p + f)'U subject to G U <= w + S p for every p with\n"
        "lower <= p <= upper.\n\n"
        "Shapes, C-contiguous float64: H (n, n) positive definite, F (n, np), f (n,), G (m, n),\n"
        "w (m,), S (m, np), lower and upper (np,), np <= 8.\n"
        "progress(explored, found) is called now and then; returning False cancels.\n"
        "threads 0: one per core; the solution does not depend on it.\n"
        "Raises ValueError for a problem that cannot be solved, RuntimeError if coverage cannot\n"
        "be reached, TimeLimit, Cancelled.");

  m.def("locate_regions", &locate_regions, "facet_first"_a, "facet_normals"_a, "facet_offsets"_a,
        "facet_kinds"_a, "neighbour_first"_a, "neighbours"_a, "p"_a, "tolerance"_a,
        "Index of a region that holds each row of p (k, np) to within `tolerance` of its facets,\n"
        "(k,) int32; -1 where there is none. The other arguments: MpqpSolution.arrays().");
}

}  // namespace eampc::law_design
