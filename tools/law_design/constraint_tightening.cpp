#include "law_design/constraint_tightening.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "law_design/design_error.hpp"

namespace eampc::law_design {
namespace {

double spectral_norm(const Eigen::Matrix2d& A) {
  return Eigen::JacobiSVD<Eigen::Matrix2d>(A).singularValues()(0);
}

// max ‖Ax + Bu‖ over the box X×U: a convex function has its maximum at a corner.
double largest_rate(const Eigen::Matrix2d& A, const Eigen::Vector2d& B, const StateBounds& bounds) {
  double largest = 0.0;
  for (const double velocity_sign : {-1.0, 1.0}) {
    for (const double control_sign : {-1.0, 1.0}) {
      // The corners with −θ mirror these.
      const Eigen::Vector2d x(bounds.angle_max_rad, velocity_sign * bounds.velocity_max_rad_s);
      largest = std::max(largest, (A * x + B * (control_sign * bounds.control_max)).norm());
    }
  }
  return largest;
}

}  // namespace

Eigen::MatrixXd theorem_tightening(const Eigen::Matrix2d& A, const Eigen::Vector2d& B,
                                   const StateBounds& bounds, const LipschitzConstants& c,
                                   double adaptation_rate_per_s, double period_s, int horizon) {
  const double l_x = spectral_norm(A);  // the smallest constants of (11)
  const double l_u = B.norm();
  const double x_max = std::hypot(bounds.angle_max_rad, bounds.velocity_max_rad_s);
  const double beta = c.l_delta * x_max + c.b_delta;  // (12)
  const double rho = c.l_delta_t * x_max + c.b_delta_t +
                     (c.l_delta_x * x_max + c.b_delta_x) * (largest_rate(A, B, bounds) + beta);
  const double gamma = 2.0 * rho * period_s - std::expm1(-adaptation_rate_per_s * period_s) * beta;
  const double excitation = l_u * bounds.control_max + c.b_delta;  // ℰ
  const double span_s = horizon * period_s;
  const double growth = l_x + c.l_delta;
  const double phi = c.l_delta * (x_max + excitation / growth) * std::expm1(growth * span_s) +
                     c.l_t * span_s + gamma;
  Eigen::MatrixXd tightening(horizon + 1, 2);
  for (int i = 0; i <= horizon; ++i) {
    tightening.row(i).setConstant(phi / l_x * std::expm1(l_x * i * period_s));
  }
  return tightening;
}

Eigen::MatrixXd componentwise_tightening(const Eigen::Matrix2d& A, const DisturbanceBounds& bounds,
                                         const EstimateQuality& estimate, double period_s,
                                         int horizon) {
  // Simpson's rule on 64 intervals per period; |·| bends the kernel at the zeros of the response,
  // which costs a relative 1e-5 of the bound and no more.
  constexpr int kIntervals = 64;
  const double step_s = period_s / kIntervals;
  const Eigen::Matrix2d transition = (A * step_s).exp();
  const int points = horizon * kIntervals + 1;
  std::vector<Eigen::Vector2d> kernel;  // |e^{As}| column 2 at s = 0, step, …
  kernel.reserve(static_cast<std::size_t>(points));
  Eigen::Vector2d response(0.0, 1.0);
  for (int k = 0; k < points; ++k) {
    kernel.push_back(response.cwiseAbs());
    response = transition * response;
  }
  const auto phi = [&](double s) {
    return std::min(
        bounds.rate_max_rad_s3 * (s + estimate.age_s) + estimate.relative_bias * bounds.max_rad_s2,
        2.0 * bounds.max_rad_s2);
  };
  Eigen::MatrixXd tightening = Eigen::MatrixXd::Zero(horizon + 1, 2);
  for (int i = 1; i <= horizon; ++i) {
    const int last = i * kIntervals;
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (int k = 0; k <= last; ++k) {
      const double weight = k == 0 || k == last ? 1.0 : (k % 2 == 1 ? 4.0 : 2.0);
      sum += weight * phi(k * step_s) * kernel[static_cast<std::size_t>(last - k)];
    }
    tightening.row(i) = (step_s / 3.0 * sum).transpose();
  }
  return tightening;
}

void require_room(const Eigen::MatrixXd& tightening, const StateBounds& bounds, const char* kind) {
  const struct {
    const char* name;
    const char* unit;
    double value;
  } limits[] = {{"constraints.angle_max_rad", "rad", bounds.angle_max_rad},
                {"constraints.velocity_max_rad_s", "rad/s", bounds.velocity_max_rad_s}};
  const bool theorem = std::string(kind) == "theorem";
  for (Eigen::Index i = 0; i < tightening.rows(); ++i) {
    for (Eigen::Index j = 0; j < 2; ++j) {
      const auto& limit = limits[j];
      if (tightening(i, j) < limit.value) continue;
      char numbers[160];
      std::snprintf(numbers, sizeof numbers, "stage %d: %s = %.4g %s is tightened by %.4g %s",
                    static_cast<int>(i), limit.name, limit.value, limit.unit, tightening(i, j),
                    limit.unit);
      throw DesignError(
          std::string("the tightened state set is empty at ") + numbers + " (tightening.kind = \"" +
          kind + "\"); " +
          (theorem ? "shorten control.horizon or control.period_s, or use tightening.kind = "
                     "\"componentwise\""
                   : "lower tightening.disturbance_max_rad_s2 or disturbance_rate_max_rad_s3, "
                     "shorten control.horizon, or raise the bound"));
    }
  }
}

}  // namespace eampc::law_design
