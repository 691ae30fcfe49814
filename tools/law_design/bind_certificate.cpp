// Python binding of the certificate: the proofs of a law, and the invariant set of its loop.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <utility>
#include <vector>

#include "law_design/bind_arrays.hpp"
#include "law_design/invariant_set.hpp"
#include "law_design/law_certificate.hpp"

using namespace nanobind::literals;

namespace eampc::law_design {
namespace {

using Words = nb::ndarray<const std::int32_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Bit j of word j/32: row j is active.
std::vector<std::vector<int>> active_sets(const Words& words, std::size_t rows) {
  if (words.shape(1) != (rows + 31) / 32) {
    throw nb::value_error("active_sets must have one bit for each row of the problem");
  }
  std::vector<std::vector<int>> result(words.shape(0));
  for (std::size_t i = 0; i < words.shape(0); ++i) {
    for (std::size_t row = 0; row < 32 * words.shape(1); ++row) {
      if ((static_cast<std::uint32_t>(words(i, row / 32)) >> (row % 32) & 1U) != 0U) {
        result[i].push_back(static_cast<int>(row));
      }
    }
  }
  return result;
}

nb::dict figures(const LawCertificate& c) {
  nb::dict d;
  d["proved"] = c.failure.empty();
  d["failure"] = c.failure;
  d["optimal"] = c.optimal;
  d["covered"] = c.covered;
  d["continuous"] = c.continuous;
  d["regions"] = static_cast<std::int64_t>(c.regions.regions.size());
  d["flat_regions"] = c.regions.flat;
  d["least_radius"] = c.regions.least_radius;
  d["smallest_eigenvalue"] = c.smallest_eigenvalue;
  d["largest_eigenvalue"] = c.largest_eigenvalue;
  d["stationarity_residual"] = c.regions.stationarity;
  d["primal_residual"] = c.regions.primal;
  d["facets"] = c.coverage.facets;
  d["facets_matched"] = c.coverage.matched;
  d["facets_walked"] = c.coverage.walked;
  d["facets_infeasible"] = c.coverage.infeasible_border;
  d["facets_uncovered"] = c.coverage.uncovered;
  d["duplicates"] = c.coverage.duplicates;
  d["gaps"] = static_cast<std::int64_t>(c.coverage.gap_regions.size());
  d["largest_gap"] = c.coverage.largest_gap;
  d["facet_slivers"] = c.coverage.slivers;
  d["plane_mismatch"] = c.coverage.plane_mismatch;
  d["law_mismatch"] = c.coverage.law_mismatch;
  d["output_jump"] = c.coverage.jump;
  d["generic_points"] = c.coverage.generic_points;
  if (c.coverage.volume >= 0.0) d["volume"] = c.coverage.volume;
  long lps = c.regions.lps + c.coverage.lps;
  if (c.evaluator) {
    d["evaluated"] = c.evaluated;
    d["cells"] = c.evaluator->cells;
    d["wrong_cells"] = c.evaluator->wrong_cells;
    d["decided_in_extended_precision"] = c.evaluator->decided_again;
    d["law_error"] = c.evaluator->law_error;
    d["sliver_cells"] = c.evaluator->slivers;
    d["sliver_error"] = c.evaluator->sliver_error;
    d["sliver_radius"] = c.evaluator->sliver_radius;
    d["edge_error"] = c.evaluator->edge_error;
    d["depth"] = c.depth;
    lps += c.evaluator->lps;
  }
  d["lps"] = lps;
  return d;
}

nb::tuple certify(const Matrix& H, const Matrix& F, const Vector& f, const Matrix& G,
                  const Vector& w, const Matrix& S, const Vector& lower, const Vector& upper,
                  const OutputLaw& output, const Words& sets,
                  const std::optional<service::LawTables>& tables, bool infeasible_allowed,
                  int threads, const nb::object& progress, bool programs_only) {
  const MpQp problem{matrix(H), matrix(F), vector(f),     matrix(G),
                     vector(w), matrix(S), vector(lower), vector(upper)};
  const std::vector<std::vector<int>> listed = active_sets(sets, w.shape(0));
  std::exception_ptr raised;
  LawCertificateOptions options;
  options.infeasible_allowed = infeasible_allowed;
  options.threads = threads;
  options.programs_only = programs_only;
  if (!progress.is_none()) {
    options.progress = [&](const char* part, int done, int all) {
      nb::gil_scoped_acquire gil;
      try {
        if (PyErr_CheckSignals() != 0) throw nb::python_error();
        const nb::object answer = progress(part, done, all);
        return answer.is_none() || nb::cast<bool>(answer);
      } catch (...) {
        raised = std::current_exception();
        return false;
      }
    };
  }
  LawCertificate certificate;
  try {
    nb::gil_scoped_release release;
    certificate = certify_law(problem, output, listed, tables ? &*tables : nullptr, options);
  } catch (const Cancelled&) {
    if (raised) std::rethrow_exception(raised);
    throw;
  }
  return nb::make_tuple(figures(certificate), certificate.seconds);
}

nb::dict invariant(const Matrix& H, const Matrix& F, const Vector& f, const Matrix& G,
                   const Vector& w, const Matrix& S, const Vector& lower, const Vector& upper,
                   const OutputLaw& output, const Words& sets, const Matrix& A, const Vector& B,
                   const Matrix& A_parameters, const Vector& input_offset, const Matrix& bound_rows,
                   const Vector& bounds, const Vector& disturbance, int samples, unsigned seed) {
  const MpQp problem{matrix(H), matrix(F), vector(f),     matrix(G),
                     vector(w), matrix(S), vector(lower), vector(upper)};
  const ClosedLoop loop{
      matrix(A),          vector(B),      matrix(A_parameters), vector(input_offset),
      matrix(bound_rows), vector(bounds), vector(disturbance)};
  const InvariantSet set =
      invariant_set(problem, output, active_sets(sets, w.shape(0)), loop, samples, seed);
  nb::dict d;
  d["found"] = set.found;
  d["statement"] = set.statement;
  d["spectral_radius"] = set.spectral_radius;
  d["facets"] = set.set.size();
  d["steps"] = set.steps;
  d["box_scaling"] = set.box_scaling;
  d["volume_fraction"] = set.volume_fraction;
  d["samples"] = set.samples;
  std::vector<double> normals, offsets;
  for (int i = 0; i < set.set.size(); ++i) {
    for (int j = 0; j < set.set.dimension(); ++j) normals.push_back(set.set.normal(i, j));
    offsets.push_back(set.set.offset(i));
  }
  const std::size_t rows = offsets.size();
  d["normals"] = nb::cast(array(std::move(normals), {rows, lower.shape(0)}));
  d["offsets"] = nb::cast(array(std::move(offsets), {rows}));
  return d;
}

}  // namespace

void bind_certificate(nb::module_& m) {
  m.def("certify_law", &certify, "H"_a, "F"_a, "f"_a, "G"_a, "w"_a, "S"_a, "lower"_a, "upper"_a,
        "output"_a, "active_sets"_a, "tables"_a = nb::none(), "infeasible_allowed"_a = false,
        "threads"_a = 0, "progress"_a = nb::none(), "programs_only"_a = false,
        "Prove a law from its problem, its active sets ((n, ceil(m/32)) int32, bit j: row j is\n"
        "active) and, if given, the tables that evaluate it.\n\n"
        "Returns (figures, seconds); figures[\"proved\"], and figures[\"failure\"] says in one\n"
        "sentence what is not. progress(part, done, all) is called now and then; returning False\n"
        "cancels. programs_only leaves out the comparisons that save most linear programs of the\n"
        "evaluator's proof; it may refuse cells too thin for it. Raises ValueError for data that\n"
        "make no sense, Cancelled.");
  m.def("invariant_set", &invariant, "H"_a, "F"_a, "f"_a, "G"_a, "w"_a, "S"_a, "lower"_a, "upper"_a,
        "output"_a, "active_sets"_a, "A"_a, "B"_a, "A_parameters"_a, "input_offset"_a,
        "bound_rows"_a, "bounds"_a, "disturbance"_a, "samples"_a = 20000, "seed"_a = 1U,
        "Largest robust output-admissible set of the loop around its equilibrium; see\n"
        "tools/law_design/invariant_set.hpp. normals @ q <= offsets in the box scaled to +-1.");
}

}  // namespace eampc::law_design
