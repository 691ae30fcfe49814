// Largest robust output-admissible set of the closed loop (Gilbert and Tan, IEEE TAC 36, 1991, with
// a disturbance as in Kolmanovsky and Gilbert, Math. Problems in Eng. 4, 1998).
//
// In the region R that holds its own equilibrium the law is one affine piece, u = g·p + g_0. With
// p = (x, r), r constant: x⁺ = A x + B (u − o·p) + A_r r + w, |w| ≤ w_max componentwise. The set
// holds every p from which the loop stays in R and within the bounds for all time, whatever w
// does: rows a·M^k p ≤ b − h_k(a), h_k(a) = Σ_{i<k} max_w a·M^i w, k = 0, 1, …, until a further k
// adds nothing, which a linear program proves for each row. r does not contract, so the rows of
// k → ∞ are added first, tightened by kMargin: with them the set is finitely determined.
#pragma once

#include <Eigen/Dense>
#include <string>
#include <vector>

#include "law_design/half_spaces.hpp"
#include "law_design/mpqp.hpp"

namespace eampc::law_design {

/// All in units of the rig; p as in the problem, the states first.
struct ClosedLoop {
  Eigen::MatrixXd A;             ///< nx×nx
  Eigen::VectorXd B;             ///< nx
  Eigen::MatrixXd A_parameters;  ///< nx×nr: A_r, nx + nr = np
  Eigen::VectorXd input_offset;  ///< np: o
  Eigen::MatrixXd bound_rows;    ///< k×np, bound_rows·p ≤ bounds besides R
  Eigen::VectorXd bounds;        ///< k
  Eigen::VectorXd disturbance;   ///< nx: w_max
};

struct InvariantSet {
  /// Rows at k → ∞ keep this distance (of the half box) from the bounds.
  static constexpr double kMargin = 1e-4;

  bool found = false;
  std::string statement;         ///< what is certified, or why nothing is
  HalfSpaces set{0};             ///< in q, the parameters scaled to ±1
  double spectral_radius = 0.0;  ///< of A + B g_x
  int steps = 0;                 ///< k at which nothing was added
  double box_scaling = 0.0;      ///< largest part of the box, about its centre, inside the set
  double volume_fraction = 0.0;  ///< of the box: an estimate from `samples` seeded points
  int samples = 0;
};

/// Throws std::invalid_argument for shapes that do not fit.
InvariantSet invariant_set(const MpQp& problem, const OutputLaw& output,
                           const std::vector<std::vector<int>>& active_sets, const ClosedLoop& loop,
                           int samples, unsigned seed);

}  // namespace eampc::law_design
