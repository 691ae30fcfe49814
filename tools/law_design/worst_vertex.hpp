// The vertex of a box at which a quadratic is largest: the worst disturbance of min-max MPC.
#pragma once

#include <Eigen/Dense>
#include <cstdint>

namespace eampc::law_design {

struct WorstVertex {
  Eigen::VectorXd signs;   // (n), each −1 or 1
  double value = 0.0;      // linear·signs + signsᵀ quadratic signs
  std::int64_t nodes = 0;  // of the search; 2^(n + 1) − 1 at most
};

/// max over s ∈ {−1, 1}^n of linear·s + sᵀ quadratic s, to rounding. Where the quadratic is convex
/// this is the maximum over the whole box [−1, 1]^n too, because a convex function is largest at a
/// vertex. `quadratic` (n×n) must be symmetric; it may be indefinite.
///
/// Depth first with branch and bound: with some signs fixed, the rest add at most
/// Σ|slope_i| + Σ_{i<j} 2|quadratic_ij|. A sign whose slope outweighs all couplings to the open
/// signs is settled without a branch. The cost of a convolution with an impulse response of one
/// sign couples all pairs alike, so few nodes are visited; the worst case is every vertex.
WorstVertex worst_vertex(const Eigen::VectorXd& linear, const Eigen::MatrixXd& quadratic);

}  // namespace eampc::law_design
