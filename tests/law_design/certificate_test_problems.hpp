// Small problems whose laws are known by hand, and tables that evaluate them.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "law_design/mpqp.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design::test {

/// min ½u² + p·u with |u| ≤ 1 on |p| ≤ 2 in np parameters, p = their sum: u = clip(−Σ p).
inline MpQp clipped_sum(int np) {
  MpQp problem;
  problem.H = Eigen::MatrixXd::Identity(1, 1);
  problem.F = Eigen::MatrixXd::Ones(1, np);
  problem.f = Eigen::VectorXd::Zero(1);
  problem.G = Eigen::MatrixXd(2, 1);
  problem.G << 1.0, -1.0;
  problem.w = Eigen::VectorXd::Ones(2);
  problem.S = Eigen::MatrixXd::Zero(2, np);
  problem.lower = Eigen::VectorXd::Constant(np, -2.0);
  problem.upper = Eigen::VectorXd::Constant(np, 2.0);
  return problem;
}

inline OutputLaw only_input(const MpQp& problem) {
  OutputLaw output;
  output.Y_U = Eigen::RowVectorXd::Ones(1);
  output.Y_p = Eigen::RowVectorXd::Zero(problem.lower.size());
  output.y_min = -1.0;
  output.y_max = 1.0;
  return output;
}

/// Active sets of clipped_sum: free, at the upper and at the lower bound.
inline std::vector<std::vector<int>> clipped_sum_sets() { return {{}, {0}, {1}}; }

/// One leaf with the given terms of pieces u = gain·Σp + offset.
inline service::LawTables lattice(int np, const std::vector<std::pair<double, double>>& pieces,
                                  const std::vector<std::vector<int>>& terms) {
  service::LawTables tables;
  tables.n_parameters = np;
  for (const auto& [gain, offset] : pieces) {
    for (int j = 0; j < np; ++j) tables.piece_gain.push_back(gain);
    tables.piece_offset.push_back(offset);
  }
  tables.root = ~0;
  tables.term_first = {0};
  for (const std::vector<int>& term : terms) {
    for (const int piece : term) tables.term_pieces.push_back(piece);
    tables.term_first.push_back(static_cast<std::int32_t>(tables.term_pieces.size()));
  }
  tables.leaf_first = {0, static_cast<std::int32_t>(terms.size())};
  tables.fold.assign(static_cast<std::size_t>(np), 0.0);
  return tables;
}

}  // namespace eampc::law_design::test
