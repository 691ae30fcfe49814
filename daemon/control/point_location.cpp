#include "control/point_location.hpp"

#include <cstddef>
#include <limits>

namespace eampc::control {
namespace {

// The order of the sum is fixed, so that every compiler and every caller gets the same bits.
double product(const double* a, const double* x) noexcept {
  const double even = (a[0] * x[0] + a[2] * x[2]) + (a[4] * x[4] + a[6] * x[6]);
  const double odd = (a[1] * x[1] + a[3] * x[3]) + (a[5] * x[5] + a[7] * x[7]);
  return even + odd;
}

}  // namespace

LawValue evaluate(const SearchTree& tree, const double* p) noexcept {
  double x[kMaxParameters] = {};
  for (int j = 0; j < tree.n_parameters; ++j) x[j] = p[j];
  std::int32_t at = tree.root;
  for (int level = 0; at >= 0 && level < tree.depth; ++level) {
    const SplitNode& node = tree.nodes[static_cast<std::size_t>(at)];
    at = product(node.normal, x) <= node.offset ? node.below : node.above;
  }
  if (at >= 0) return {std::numeric_limits<double>::quiet_NaN(), -1};
  const std::int32_t piece = ~at;
  const AffinePiece& law = tree.pieces[static_cast<std::size_t>(piece)];
  return {product(law.gain, x) + law.offset, piece};
}

}  // namespace eampc::control
