// Python binding of a law's tables: built from regions, made from arrays, evaluated by the daemon's
// own code.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <cstdint>
#include <exception>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "law_design/bind_arrays.hpp"
#include "law_design/law_structure.hpp"
#include "law_design/mpqp.hpp"
#include "service/law_cost.hpp"
#include "service/law_packing.hpp"
#include "service/law_tables.hpp"

using namespace nanobind::literals;

namespace eampc::law_design {
namespace {

using service::LawTables;
using Integers = nb::ndarray<const std::int32_t, nb::c_contig, nb::device::cpu>;

nb::tuple build_tables(const MpQpSolution& solution, const OutputLaw& output,
                       const nb::object& progress, int threads) {
  std::exception_ptr raised;
  LawStructureOptions options;
  options.threads = threads;
  const std::function<bool(int, int)> report = progress_function(progress, raised);
  if (report) {
    options.progress = [&report](long nodes, long) { return report(static_cast<int>(nodes), 0); };
  }
  LawStructure structure;
  try {
    nb::gil_scoped_release release;
    structure = build_law_structure(solution, output, options);
  } catch (const Cancelled&) {
    if (raised) std::rethrow_exception(raised);
    throw;
  }
  nb::dict s;
  s["regions"] = structure.regions;
  s["unsaturated_regions"] = structure.unsaturated_regions;
  s["distinct_laws"] = structure.distinct_laws;
  s["binary_nodes"] = structure.binary_nodes;
  s["binary_depth"] = structure.binary_depth;
  s["lps"] = structure.lps;
  s["seconds"] = structure.seconds;
  return nb::make_tuple(std::move(structure.tables), s);
}

template <typename T, typename Array>
std::vector<T> values(const Array& array) {
  return std::vector<T>(array.data(), array.data() + array.size());
}

// (n, 2) low and high 32 bits, as in the law file.
std::vector<std::uint64_t> masks(const Integers& halves) {
  std::vector<std::uint64_t> result(halves.size() / 2);
  for (std::size_t k = 0; k < result.size(); ++k) {
    result[k] = static_cast<std::uint32_t>(halves.data()[2 * k]) |
                std::uint64_t{static_cast<std::uint32_t>(halves.data()[2 * k + 1])} << 32;
  }
  return result;
}

nb::ndarray<nb::numpy, std::int32_t> halves(const std::vector<std::uint64_t>& masks) {
  std::vector<std::int32_t> result;
  for (const std::uint64_t mask : masks) {
    result.push_back(static_cast<std::int32_t>(static_cast<std::uint32_t>(mask)));
    result.push_back(static_cast<std::int32_t>(static_cast<std::uint32_t>(mask >> 32)));
  }
  return array(std::move(result), {masks.size(), std::size_t{2}});
}

LawTables tables_from_arrays(const std::string& kind, const Matrix& piece_gain,
                             const Vector& piece_offset, const Matrix& hyperplanes,
                             std::int32_t root, int depth, const Integers& node_planes,
                             const Integers& node_children, const Integers& leaf_care,
                             const Integers& leaf_bits, const Integers& leaf_first,
                             const Integers& term_first, const Integers& term_pieces,
                             const Vector& fold) {
  if (kind != "tree" && kind != "flat") throw nb::value_error("kind must be \"tree\" or \"flat\"");
  LawTables t;
  t.n_parameters = static_cast<int>(piece_gain.shape(1));
  t.flat = kind == "flat";
  t.piece_gain = values<double>(piece_gain);
  t.piece_offset = values<double>(piece_offset);
  t.hyperplanes = values<double>(hyperplanes);
  t.root = root;
  t.depth = depth;
  t.node_planes = values<std::int32_t>(node_planes);
  t.node_children = values<std::int32_t>(node_children);
  t.leaf_care = masks(leaf_care);
  t.leaf_bits = masks(leaf_bits);
  t.leaf_first = values<std::int32_t>(leaf_first);
  t.term_first = values<std::int32_t>(term_first);
  t.term_pieces = values<std::int32_t>(term_pieces);
  t.fold = values<double>(fold);
  if (const auto defect = service::find_defect(t)) {
    throw nb::value_error((defect->key + " " + defect->what).c_str());
  }
  return t;
}

nb::tuple evaluate_tables(const LawTables& tables, const Matrix& p, const std::string& path) {
  if (p.shape(1) != static_cast<std::size_t>(tables.n_parameters)) {
    throw nb::value_error("p must have one column for each parameter of the law");
  }
  const service::LawPacking packing(tables, service::evaluation_path(path));
  std::vector<double> u(p.shape(0));
  std::vector<std::int32_t> piece(p.shape(0));
  {
    nb::gil_scoped_release release;
    for (std::size_t i = 0; i < u.size(); ++i) {
      const control::LawValue value = control::evaluate(packing.law(), p.data() + i * p.shape(1));
      u[i] = value.u;
      piece[i] = value.piece;
    }
  }
  const std::size_t count = u.size();
  return nb::make_tuple(array(std::move(u), {count}), array(std::move(piece), {count}));
}

nb::ndarray<nb::numpy, std::int32_t> rows(const std::vector<std::int32_t>& of,
                                          std::size_t columns) {
  return array(of, {of.size() / columns, columns});
}

}  // namespace

void bind_law_tables(nb::module_& m) {
  nb::class_<LawTables>(
      m, "LawTables",
      "Pieces and evaluator of a law, as in the law file (see eampc.law_file).\n\n"
      "The arrays are checked: ValueError names the key that is wrong.")
      .def(
          "__init__",
          [](LawTables* self, const std::string& kind, const Matrix& piece_gain,
             const Vector& piece_offset, const Matrix& hyperplanes, std::int32_t root, int depth,
             const Integers& node_planes, const Integers& node_children, const Integers& leaf_care,
             const Integers& leaf_bits, const Integers& leaf_first, const Integers& term_first,
             const Integers& term_pieces, const Vector& fold) {
            new (self) LawTables(tables_from_arrays(
                kind, piece_gain, piece_offset, hyperplanes, root, depth, node_planes,
                node_children, leaf_care, leaf_bits, leaf_first, term_first, term_pieces, fold));
          },
          nb::kw_only(), "kind"_a, "piece_gain"_a, "piece_offset"_a, "hyperplanes"_a, "root"_a,
          "depth"_a, "node_planes"_a, "node_children"_a, "leaf_care"_a, "leaf_bits"_a,
          "leaf_first"_a, "term_first"_a, "term_pieces"_a, "fold"_a)
      .def_prop_ro("kind", [](const LawTables& t) { return t.flat ? "flat" : "tree"; })
      .def_ro("root", &LawTables::root)
      .def_ro("depth", &LawTables::depth)
      .def_prop_ro(
          "piece_gain",
          [](const LawTables& t) {
            return array(t.piece_gain, {t.n_pieces(), static_cast<std::size_t>(t.n_parameters)});
          },
          nb::rv_policy::automatic, "(n_pieces, np)")
      .def_prop_ro(
          "piece_offset", [](const LawTables& t) { return array(t.piece_offset, {t.n_pieces()}); },
          nb::rv_policy::automatic, "(n_pieces,)")
      .def_prop_ro(
          "hyperplanes",
          [](const LawTables& t) {
            return array(t.hyperplanes,
                         {t.n_planes(), static_cast<std::size_t>(t.n_parameters) + 1});
          },
          nb::rv_policy::automatic, "(n_planes, np+1): normal, offset")
      .def_prop_ro(
          "node_planes", [](const LawTables& t) { return rows(t.node_planes, 7); },
          nb::rv_policy::automatic, "(n_nodes, 7)")
      .def_prop_ro(
          "node_children", [](const LawTables& t) { return rows(t.node_children, 8); },
          nb::rv_policy::automatic, "(n_nodes, 8)")
      .def_prop_ro(
          "leaf_care", [](const LawTables& t) { return halves(t.leaf_care); },
          nb::rv_policy::automatic, "(n_leaves, 2): low, high 32 bits; empty for a tree")
      .def_prop_ro(
          "leaf_bits", [](const LawTables& t) { return halves(t.leaf_bits); },
          nb::rv_policy::automatic, "(n_leaves, 2)")
      .def_prop_ro(
          "leaf_first",
          [](const LawTables& t) { return array(t.leaf_first, {t.leaf_first.size()}); },
          nb::rv_policy::automatic, "(n_leaves+1,), into term_first")
      .def_prop_ro(
          "term_first",
          [](const LawTables& t) { return array(t.term_first, {t.term_first.size()}); },
          nb::rv_policy::automatic, "(n_terms+1,), into term_pieces")
      .def_prop_ro(
          "term_pieces",
          [](const LawTables& t) { return array(t.term_pieces, {t.term_pieces.size()}); },
          nb::rv_policy::automatic)
      .def_prop_ro(
          "fold", [](const LawTables& t) { return array(t.fold, {t.fold.size()}); },
          nb::rv_policy::automatic, "(np,)")
      .def_prop_ro("worst_operations", &service::evaluation_cost,
                   "Bound on the operations of one evaluation (daemon/service/law_cost.hpp).");

  m.def("build_law_tables", &build_tables, "solution"_a, "output"_a, "progress"_a = nb::none(),
        "threads"_a = 0,
        "Sort the output of a solution (all regions) into pieces and a proved evaluator.\n\n"
        "Returns (LawTables, dict of statistics). The value of the law is not clipped: the caller\n"
        "clips it to y_min, y_max. progress(nodes, 0): as in solve_mpqp. threads: 0 is one per\n"
        "core; the tables do not depend on it. RuntimeError if a cell cannot be proved.");

  m.def("evaluate_tables", &evaluate_tables, "tables"_a, "p"_a, "path"_a = "best",
        "Evaluate a law at every row of p (k, np) with the daemon's code.\n\n"
        "path: best, scalar, vector128, avx2 or avx512; ValueError if this processor lacks it.\n"
        "Returns (u (k,) not clipped, piece (k,) int32, -1 with u = NaN where none applies).");
}

}  // namespace eampc::law_design
