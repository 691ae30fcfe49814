// Python binding of the multiparametric QP solver and the search-tree builder.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <Eigen/Dense>
#include <cstdint>
#include <optional>
#include <utility>

#include "control/point_location.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/search_tree.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::MatrixXd matrix(const Matrix& a) {
  return Eigen::Map<const RowMajor>(a.data(), static_cast<Eigen::Index>(a.shape(0)),
                                    static_cast<Eigen::Index>(a.shape(1)));
}

Eigen::VectorXd vector(const Vector& a) {
  return Eigen::Map<const Eigen::VectorXd>(a.data(), static_cast<Eigen::Index>(a.shape(0)));
}

template <typename T>
nb::ndarray<nb::numpy, T> array(std::vector<T> values, std::initializer_list<std::size_t> shape) {
  auto* owned = new std::vector<T>(std::move(values));
  nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, T>(owned->data(), shape, owner);
}

nb::ndarray<nb::numpy, double> array(const Eigen::MatrixXd& a) {
  std::vector<double> values(static_cast<std::size_t>(a.size()));
  Eigen::Map<RowMajor>(values.data(), a.rows(), a.cols()) = a;
  return array(std::move(values),
               {static_cast<std::size_t>(a.rows()), static_cast<std::size_t>(a.cols())});
}

nb::ndarray<nb::numpy, double> array(const Eigen::VectorXd& a) {
  return array(std::vector<double>(a.data(), a.data() + a.size()),
               {static_cast<std::size_t>(a.size())});
}

// The solver runs without the GIL; the callback takes it back. An exception in the callback
// cancels and is raised again afterwards.
std::function<bool(int, int)> progress_function(const nb::object& progress,
                                                std::exception_ptr& raised) {
  if (progress.is_none()) return {};
  return [&progress, &raised](int done, int known) {
    nb::gil_scoped_acquire gil;
    try {
      if (PyErr_CheckSignals() != 0) throw nb::python_error();
      const nb::object answer = progress(done, known);
      return answer.is_none() || nb::cast<bool>(answer);
    } catch (...) {
      raised = std::current_exception();
      return false;
    }
  };
}

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

nb::dict build_tree(const MpQpSolution& solution, const OutputLaw& output,
                    const nb::object& progress, int max_nodes) {
  std::exception_ptr raised;
  SearchTreeOptions options;
  options.max_nodes = max_nodes;
  options.progress = progress_function(progress, raised);
  BuiltSearchTree tree;
  try {
    nb::gil_scoped_release release;
    tree = build_search_tree(solution, output, options);
  } catch (const Cancelled&) {
    if (raised) std::rethrow_exception(raised);
    throw;
  }
  const std::size_t np = static_cast<std::size_t>(tree.n_parameters);
  std::vector<double> hyperplanes, gains, offsets;
  std::vector<std::int32_t> children;
  for (const control::SplitNode& node : tree.nodes) {
    hyperplanes.insert(hyperplanes.end(), node.normal, node.normal + np);
    hyperplanes.push_back(node.offset);
    children.push_back(node.below);
    children.push_back(node.above);
  }
  for (const control::AffinePiece& piece : tree.pieces) {
    gains.insert(gains.end(), piece.gain, piece.gain + np);
    offsets.push_back(piece.offset);
  }
  nb::dict s;
  s["unsaturated_regions"] = tree.statistics.unsaturated_regions;
  s["distinct_laws"] = tree.statistics.distinct_laws;
  s["nodes"] = tree.statistics.nodes;
  s["leaves"] = tree.statistics.leaves;
  s["pieces"] = tree.statistics.pieces;
  s["depth"] = tree.statistics.depth;
  s["lps"] = tree.statistics.lps;
  s["sliver_leaves"] = tree.statistics.sliver_leaves;
  s["infeasible_leaves"] = tree.statistics.infeasible_leaves;
  s["seconds"] = tree.statistics.seconds;
  nb::dict d;
  d["hyperplanes"] = nb::cast(array(std::move(hyperplanes), {tree.nodes.size(), np + 1}));
  d["children"] = nb::cast(array(std::move(children), {tree.nodes.size(), std::size_t{2}}));
  d["piece_gain"] = nb::cast(array(std::move(gains), {tree.pieces.size(), np}));
  d["piece_offset"] = nb::cast(array(std::move(offsets), {tree.pieces.size()}));
  d["depth"] = tree.depth;
  d["root"] = tree.root;
  d["statistics"] = s;
  return d;
}

using Children = nb::ndarray<const std::int32_t, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;

nb::tuple evaluate_tree(const Matrix& hyperplanes, const Children& children,
                        const Matrix& piece_gain, const Vector& piece_offset, int depth,
                        std::int32_t root, const Matrix& p) {
  const std::size_t np = p.shape(1);
  if (np > control::kMaxParameters || hyperplanes.shape(1) != np + 1 || piece_gain.shape(1) != np ||
      children.shape(0) != hyperplanes.shape(0) || piece_offset.shape(0) != piece_gain.shape(0)) {
    throw nb::value_error("evaluate_search_tree: shapes do not fit together");
  }
  std::vector<control::SplitNode> nodes(hyperplanes.shape(0));
  std::vector<control::AffinePiece> pieces(piece_gain.shape(0));
  const auto in_range = [&](std::int32_t child) {
    return child >= 0 ? static_cast<std::size_t>(child) < nodes.size()
                      : static_cast<std::size_t>(~child) < pieces.size();
  };
  bool valid = in_range(root);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    nodes[i] = control::SplitNode{};
    for (std::size_t j = 0; j < np; ++j) nodes[i].normal[j] = hyperplanes(i, j);
    nodes[i].offset = hyperplanes(i, np);
    nodes[i].below = children(i, 0);
    nodes[i].above = children(i, 1);
    valid = valid && in_range(nodes[i].below) && in_range(nodes[i].above);
  }
  if (!valid) throw nb::value_error("evaluate_search_tree: a child is out of range");
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    pieces[i] = control::AffinePiece{};
    for (std::size_t j = 0; j < np; ++j) pieces[i].gain[j] = piece_gain(i, j);
    pieces[i].offset = piece_offset(i);
  }
  const control::SearchTree tree{nodes, pieces, static_cast<int>(np), depth, root};
  std::vector<double> u(p.shape(0));
  std::vector<std::int32_t> piece(p.shape(0));
  for (std::size_t i = 0; i < u.size(); ++i) {
    const control::LawValue value = control::evaluate(tree, p.data() + i * np);
    u[i] = value.u;
    piece[i] = value.piece;
  }
  const std::size_t count = u.size();
  return nb::make_tuple(array(std::move(u), {count}), array(std::move(piece), {count}));
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

  m.def("build_search_tree", &build_tree, "solution"_a, "output"_a, "progress"_a = nb::none(),
        "max_nodes"_a = 1000000,
        "Sort the output of a solution into a proved binary search tree.\n\n"
        "Returns a dict: hyperplanes (n_nodes, np+1) float64, normal then offset, normal @ p <=\n"
        "offset leads to children[:, 0]; children (n_nodes, 2) int32, a child c < 0 is the piece\n"
        "~c; piece_gain (n_pieces, np); piece_offset (n_pieces,); depth; root; statistics.\n"
        "The value of a piece is not clipped: the caller clips it to y_min, y_max.\n"
        "progress(nodes, regions_in_cell): as in solve_mpqp. RuntimeError if a leaf cannot be\n"
        "proved.");

  m.def("evaluate_search_tree", &evaluate_tree, "hyperplanes"_a, "children"_a, "piece_gain"_a,
        "piece_offset"_a, "depth"_a, "root"_a, "p"_a,
        "Evaluate the tree at every row of p (k, np) with the daemon's code.\n\n"
        "Returns (u (k,) not clipped, piece (k,) int32).");
}

}  // namespace eampc::law_design
