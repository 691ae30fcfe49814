#include "law_design/discretisation.hpp"

#include <unsupported/Eigen/MatrixFunctions>

namespace eampc::law_design {

SampledModel discretise(const Eigen::MatrixXd& A, const Eigen::VectorXd& B, double period_s) {
  const Eigen::Index n = A.rows();
  Eigen::MatrixXd block = Eigen::MatrixXd::Zero(2 * n + 1, 2 * n + 1);
  block.topLeftCorner(n, n) = A;
  block.block(0, n, n, 1) = B;
  block.topRightCorner(n, n).setIdentity();
  const Eigen::MatrixXd exponential = (block * period_s).exp();

  SampledModel sampled;
  sampled.period_s = period_s;
  sampled.A_star = exponential.topLeftCorner(n, n);
  sampled.B_star = exponential.block(0, n, n, 1);
  sampled.D = exponential.block(0, n + 1, n, 2);
  return sampled;
}

}  // namespace eampc::law_design
