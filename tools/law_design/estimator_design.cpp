#include "law_design/estimator_design.hpp"

#include <cmath>
#include <numbers>
#include <unsupported/Eigen/MatrixFunctions>

#include "law_design/design_error.hpp"
#include "law_design/terminal_cost.hpp"

namespace eampc::law_design {

double estimator_decay(double adaptation_rate_per_s, double period_s) {
  return std::exp(-adaptation_rate_per_s * period_s);
}

Eigen::Matrix2d disturbance_inverse(const SampledModel& model) {
  return model.D.topRows<2>().inverse();
}

double low_pass_alpha(double frequency_hz, double period_s) {
  if (frequency_hz <= 0.0) return 1.0;
  return -std::expm1(-2.0 * std::numbers::pi * frequency_hz * period_s);
}

KalmanGains kalman_gains(const Eigen::Matrix2d& joint_A, const KalmanNoise& noise,
                         double period_s) {
  if (!(noise.angle_noise_rad > 0.0) || !(noise.disturbance_walk_rad_s2_sqrt_Hz > 0.0)) {
    throw DesignError(
        "the Kalman estimator needs estimator.angle_noise_rad and "
        "estimator.disturbance_walk_rad_s2_sqrt_Hz above zero");
  }
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  A.topLeftCorner<2, 2>() = joint_A;
  A(1, 2) = 1.0;
  Eigen::Matrix3d intensity = Eigen::Matrix3d::Zero();
  intensity(1, 1) = std::pow(noise.velocity_walk_rad_s_sqrt_Hz, 2);
  intensity(2, 2) = std::pow(noise.disturbance_walk_rad_s2_sqrt_Hz, 2);

  // Van Loan 1978: one exponential gives the transition F and the noise of one period.
  Eigen::Matrix<double, 6, 6> block = Eigen::Matrix<double, 6, 6>::Zero();
  block.topLeftCorner<3, 3>() = -A;
  block.topRightCorner<3, 3>() = intensity;
  block.bottomRightCorner<3, 3>() = A.transpose();
  const Eigen::Matrix<double, 6, 6> exponential = (block * period_s).exp();
  const Eigen::Matrix3d F = exponential.bottomRightCorner<3, 3>().transpose();
  const Eigen::Matrix3d process_noise = F * exponential.topRightCorner<3, 3>();

  // The filter's Riccati equation is the regulator's, transposed.
  const Eigen::Vector3d C(1.0, 0.0, 0.0);
  const double r = noise.angle_noise_rad * noise.angle_noise_rad;
  const Eigen::MatrixXd P =
      riccati_solution(F.transpose(), C, 0.5 * (process_noise + process_noise.transpose()),
                       Eigen::MatrixXd::Constant(1, 1, r));
  const Eigen::VectorXd gain = P.col(0) / (P(0, 0) + r);
  return {.state = gain.head<2>(), .disturbance = gain(2)};
}

}  // namespace eampc::law_design
