#include "law_design/binary_tree.hpp"

#include <cstddef>
#include <limits>

namespace eampc::law_design {
namespace {

double product(const double* a, const double* x, int count) noexcept {
  double sum = 0.0;
  for (int j = 0; j < count; ++j) sum += a[j] * x[j];
  return sum;
}

}  // namespace

control::LawValue evaluate(const BinaryTree& tree, const double* p) noexcept {
  std::int32_t at = tree.root;
  for (int level = 0; at >= 0 && level < tree.depth; ++level) {
    const SplitNode& node = tree.nodes[static_cast<std::size_t>(at)];
    at = product(node.normal, p, tree.n_parameters) <= node.offset ? node.below : node.above;
  }
  if (at >= 0) return {std::numeric_limits<double>::quiet_NaN(), -1};
  const AffinePiece& piece = tree.pieces[static_cast<std::size_t>(~at)];
  return {product(piece.gain, p, tree.n_parameters) + piece.offset, ~at};
}

}  // namespace eampc::law_design
