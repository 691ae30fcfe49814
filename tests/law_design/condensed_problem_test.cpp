#include "law_design/condensed_problem.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "law_design/design_error.hpp"
#include "law_design/joint_model.hpp"
#include "law_design/terminal_cost.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

// Oracle: the model stepped stage by stage, cost and distance to every bound added up on the way.
struct Rollout {
  double cost = 0.0;
  std::vector<double> slacks;  // bound minus value, in the units of the rows
};

void add_bounds(Rollout& rollout, double value, double bound, double slack) {
  rollout.slacks.push_back(1.0 + slack - value / bound);
  rollout.slacks.push_back(1.0 + slack + value / bound);
}

void expect_same(const CondensedProblem& condensed, const Eigen::VectorXd& p,
                 const Eigen::VectorXd& U, const Rollout& at_U, const Rollout& at_zero) {
  const MpQp& q = condensed.mpqp;
  const double cost = 0.5 * U.dot(q.H * U) + (q.F * p + q.f).dot(U);
  EXPECT_NEAR(cost, at_U.cost - at_zero.cost, 1e-9 * (1.0 + std::abs(at_U.cost)));
  const Eigen::VectorXd rows = q.w + q.S * p - q.G * U;
  std::vector<double> found(rows.data(), rows.data() + rows.size());
  std::vector<double> expected = at_U.slacks;
  ASSERT_EQ(found.size(), expected.size());
  std::sort(found.begin(), found.end());
  std::sort(expected.begin(), expected.end());
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-9);
}

ControlProblem settings(int horizon, int control_horizon, Eigen::Index parameters) {
  ControlProblem problem;
  problem.horizon = horizon;
  problem.control_horizon = control_horizon;
  problem.weight_angle = 100.0;
  problem.weight_velocity = 0.5;
  problem.weight_control = 0.01;
  problem.weight_control_rate = 0.03;
  problem.angle_max_rad = 1.0;
  problem.velocity_max_rad_s = 6.0;
  problem.control_max = 11.0;
  problem.slack_linear = 1000.0;
  problem.slack_quadratic = 10000.0;
  problem.tightening = Eigen::MatrixXd::Zero(horizon + 1, 2);
  for (int i = 0; i <= horizon; ++i) problem.tightening.row(i) << 0.01 * i, 0.05 * i;
  problem.upper = Eigen::VectorXd::Ones(parameters);
  problem.lower = -problem.upper;
  return problem;
}

Rollout tracking_rollout(const SampledModel& model, const ControlProblem& problem,
                         const Eigen::VectorXd& p, const Eigen::VectorXd& U) {
  const Eigen::Index n = model.A_star.rows();
  const double u_ss = p(n), y_r = p(n + 1), y_r_rate = p(n + 2), s = U(problem.control_horizon);
  Eigen::VectorXd weights = Eigen::VectorXd::Zero(n);
  weights.head<2>() << problem.weight_angle, problem.weight_velocity;
  const Eigen::MatrixXd Q = weights.asDiagonal();
  const Eigen::MatrixXd R = Eigen::MatrixXd::Constant(1, 1, problem.weight_control);
  Rollout rollout;
  rollout.slacks.push_back(s);
  rollout.cost = problem.slack_linear * s + problem.slack_quadratic * s * s;
  Eigen::VectorXd e = p.head(n);
  double previous = 0.0;
  for (int i = 0; i < problem.horizon; ++i) {
    const double V = i < problem.control_horizon ? U(i) : 0.0;
    rollout.cost += e.dot(Q * e) + problem.weight_control * V * V;
    if (i > 0) rollout.cost += problem.weight_control_rate * (V - previous) * (V - previous);
    if (i < problem.control_horizon) {
      rollout.slacks.push_back(problem.control_max - (V + u_ss));
      rollout.slacks.push_back(problem.control_max + (V + u_ss));
    }
    previous = V;
    e = model.A_star * e + model.B_star * V;
    if ((problem.horizon - (i + 1)) % problem.stage_step != 0) continue;
    const double t = (i + 1) * model.period_s;
    add_bounds(rollout, e(0) + y_r + t * y_r_rate,
               problem.angle_max_rad - problem.tightening(i + 1, 0), s);
    add_bounds(rollout, e(1) + y_r_rate, problem.velocity_max_rad_s - problem.tightening(i + 1, 1),
               s);
  }
  rollout.cost += e.dot(riccati_solution(model.A_star, model.B_star, Q, R) * e);
  return rollout;
}

TEST(TrackingProblem, AgreesWithARollout) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const bool has_valves : {true, false}) {
    JointData rig = reference_rig();
    if (!has_valves) rig.valve_time_constant_s = 0.0;
    const ContinuousModel continuous = joint_model(rig);
    const SampledModel model = discretise(continuous.A, continuous.B, 0.005);
    const Eigen::Index np = continuous.order() + 3;
    const ControlProblem problem = settings(12, 5, np);
    const CondensedProblem condensed = tracking_problem(model, problem);
    EXPECT_EQ(condensed.mpqp.H.rows(), 6);
    EXPECT_EQ(condensed.mpqp.w.size(), 2 * 5 + 4 * 12 + 1);
    EXPECT_EQ(condensed.output_U, Eigen::VectorXd(Eigen::VectorXd::Unit(6, 0)));
    EXPECT_EQ(condensed.output_p, Eigen::VectorXd(Eigen::VectorXd::Unit(np, continuous.order())));
    for (int run = 0; run < 20; ++run) {
      const Eigen::VectorXd p = Eigen::VectorXd::NullaryExpr(np, [&] { return uniform(random); });
      const Eigen::VectorXd U =
          Eigen::VectorXd::NullaryExpr(6, [&] { return 5.0 * uniform(random); });
      expect_same(condensed, p, U, tracking_rollout(model, problem, p, U),
                  tracking_rollout(model, problem, p, Eigen::VectorXd::Zero(6)));
    }
  }
}

Rollout paper_rollout(const SampledModel& model, const ControlProblem& problem,
                      const Eigen::VectorXd& p, const Eigen::VectorXd& U) {
  const double y_r = problem.reference_is_parameter ? p(4) : problem.fixed_reference_rad;
  const double s = problem.soft_state_bounds ? U(problem.control_horizon) : 0.0;
  Rollout rollout;
  if (problem.soft_state_bounds) {
    rollout.slacks.push_back(s);
    rollout.cost = problem.slack_linear * s + problem.slack_quadratic * s * s;
  }
  Eigen::Vector2d x = p.head<2>();
  for (int i = 0; i <= problem.horizon; ++i) {
    rollout.cost += problem.weight_angle * (x(0) - y_r) * (x(0) - y_r);
    if (i > 0) {
      for (int j = 0; j < 2; ++j) {
        const double bound = j == 0 ? problem.angle_max_rad : problem.velocity_max_rad_s;
        add_bounds(rollout, x(j), bound - problem.tightening(i, j), s);
      }
    }
    if (i == problem.horizon) break;
    const double u = U(std::min(i, problem.control_horizon - 1));
    rollout.cost += problem.weight_control * u * u;
    if (i < problem.control_horizon) {
      rollout.slacks.push_back(problem.control_max - u);
      rollout.slacks.push_back(problem.control_max + u);
    }
    x = (model.A_star * x + model.B_star * u + model.D * p.segment<2>(2)).eval();
  }
  return rollout;
}

TEST(TrackingProblem, StateBoundsAtEveryFourthStage) {
  const ContinuousModel continuous = joint_model(reference_rig());
  const SampledModel model = discretise(continuous.A, continuous.B, 0.005);
  ControlProblem problem = settings(10, 5, 6);
  problem.stage_step = 4;  // stages 10, 6, 2
  const CondensedProblem condensed = tracking_problem(model, problem);
  EXPECT_EQ(condensed.mpqp.w.size(), 2 * 5 + 4 * 3 + 1);
  const Eigen::VectorXd p = Eigen::VectorXd::LinSpaced(6, -0.4, 0.6);
  const Eigen::VectorXd U = Eigen::VectorXd::LinSpaced(6, 3.0, -2.0);
  expect_same(condensed, p, U, tracking_rollout(model, problem, p, U),
              tracking_rollout(model, problem, p, Eigen::VectorXd::Zero(6)));
}

TEST(PaperProblem, AgreesWithARollout) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const double bias_V : {2.0, 0.0}) {
    const ContinuousModel continuous = joint_model(paper_rig(bias_V));
    const SampledModel model = discretise(continuous.A, continuous.B, 0.005);
    for (const int variant : {0, 1, 2, 3}) {
      const Eigen::Index np = variant == 1 ? 5 : 4;
      ControlProblem problem = settings(10, variant == 2 ? 4 : 10, np);
      problem.reference_is_parameter = variant == 1;
      problem.fixed_reference_rad = 0.7;
      problem.soft_state_bounds = variant != 3;
      const CondensedProblem condensed = paper_problem(model, problem);
      const Eigen::Index n = condensed.mpqp.H.rows();
      EXPECT_EQ(n, problem.control_horizon + (problem.soft_state_bounds ? 1 : 0));
      EXPECT_EQ(condensed.output_p, Eigen::VectorXd(Eigen::VectorXd::Zero(np)));
      for (int run = 0; run < 20; ++run) {
        const Eigen::VectorXd p = Eigen::VectorXd::NullaryExpr(np, [&] { return uniform(random); });
        const Eigen::VectorXd U =
            Eigen::VectorXd::NullaryExpr(n, [&] { return 40.0 * uniform(random); });
        expect_same(condensed, p, U, paper_rollout(model, problem, p, U),
                    paper_rollout(model, problem, p, Eigen::VectorXd::Zero(n)));
      }
    }
  }
}

TEST(CondensedProblem, RefusesWhatItCannotPose) {
  const ContinuousModel with_valves = joint_model(reference_rig());
  const SampledModel model = discretise(with_valves.A, with_valves.B, 0.005);
  EXPECT_THROW(paper_problem(model, settings(5, 5, 4)), DesignError);
  EXPECT_THROW(tracking_problem(model, settings(5, 6, 6)), DesignError);
  EXPECT_THROW(tracking_problem(model, settings(5, 5, 5)), DesignError);
  ControlProblem wrong_tightening = settings(5, 5, 6);
  wrong_tightening.tightening = Eigen::MatrixXd::Zero(3, 2);
  EXPECT_THROW(tracking_problem(model, wrong_tightening), DesignError);
}

}  // namespace
}  // namespace eampc::law_design
