// Python binding of the search-tree builder and of the evaluation of its trees.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <exception>
#include <utility>
#include <vector>

#include "control/point_location.hpp"
#include "law_design/bind_arrays.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/search_tree.hpp"

using namespace nanobind::literals;

namespace eampc::law_design {
namespace {

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

void bind_law_tables(nb::module_& m) {
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
