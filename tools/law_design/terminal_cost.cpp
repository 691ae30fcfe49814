#include "law_design/terminal_cost.hpp"

#include "law_design/design_error.hpp"

namespace eampc::law_design {

// Structure-preserving doubling (Chu, Fan, Lin, Wang 2004): step k holds 2^k Riccati iterations,
// so a closed loop with its slowest pole at 1 − 1e-6 converges in under 30 steps.
Eigen::MatrixXd riccati_solution(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                 const Eigen::MatrixXd& Q, const Eigen::MatrixXd& R) {
  constexpr int kMaxSteps = 60;
  constexpr double kConverged = 1e-14;  // relative change of P: a few ulp
  const Eigen::Index n = A.rows();
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(n, n);
  Eigen::MatrixXd transition = A;
  Eigen::MatrixXd G = B * R.ldlt().solve(B.transpose());
  Eigen::MatrixXd P = Q;
  for (int step = 0; step < kMaxSteps; ++step) {
    const Eigen::MatrixXd W = (identity + G * P).partialPivLu().inverse();
    const Eigen::MatrixXd increment = transition.transpose() * P * W * transition;
    const Eigen::MatrixXd next_G = G + transition * W * G * transition.transpose();
    transition = transition * W * transition;
    G = 0.5 * (next_G + next_G.transpose());
    P += 0.5 * (increment + increment.transpose());
    if (!P.allFinite()) break;
    if (increment.cwiseAbs().maxCoeff() <= kConverged * P.cwiseAbs().maxCoeff()) return P;
  }
  throw DesignError(
      "the Riccati equation has no stabilising solution for this model and these weights; check "
      "control.weight_angle, control.weight_control and the [joint] and [muscle] tables");
}

}  // namespace eampc::law_design
