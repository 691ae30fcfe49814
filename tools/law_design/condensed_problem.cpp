#include "law_design/condensed_problem.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "law_design/design_error.hpp"
#include "law_design/terminal_cost.hpp"

namespace eampc::law_design {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

// States at one stage, x_i = of_moves·U + of_parameters·p.
struct Prediction {
  MatrixXd of_moves;
  MatrixXd of_parameters;
};

// ½UᵀHU + (Fp + f)ᵀU and G U ≤ w + S p, grown term by term. The slack, if any, is the last of U.
class ProblemBuilder {
 public:
  ProblemBuilder(Index moves, Index parameters, const ControlProblem& problem)
      : soft_(problem.soft_state_bounds), parameters_(parameters) {
    const Index n = moves + (soft_ ? 1 : 0);
    mpqp_.H = MatrixXd::Zero(n, n);
    mpqp_.F = MatrixXd::Zero(n, parameters);
    mpqp_.f = VectorXd::Zero(n);
    mpqp_.lower = problem.lower;
    mpqp_.upper = problem.upper;
    if (soft_) {
      mpqp_.H(n - 1, n - 1) = 2.0 * problem.slack_quadratic;
      mpqp_.f(n - 1) = problem.slack_linear;
    }
  }

  // (a·U + b·p + c)ᵀ W (a·U + b·p + c)
  void add_cost(const MatrixXd& W, const MatrixXd& a, const MatrixXd& b, const VectorXd& c) {
    const Index moves = a.cols();
    mpqp_.H.topLeftCorner(moves, moves) += 2.0 * a.transpose() * W * a;
    mpqp_.F.topRows(moves) += 2.0 * a.transpose() * W * b;
    mpqp_.f.head(moves) += 2.0 * a.transpose() * W * c;
  }

  // |a·U + b·p| ≤ bound, hard.
  void add_input_bound(const RowVectorXd& a, const RowVectorXd& b, double bound) {
    for (const double sign : {1.0, -1.0}) add_row(sign * a, sign * b, bound, 0.0);
  }

  // |a·U + b·p| ≤ bound (1 + s), as rows of the size of the slack.
  void add_state_bound(const RowVectorXd& a, const RowVectorXd& b, double bound) {
    for (const double sign : {1.0, -1.0}) add_row(sign / bound * a, sign / bound * b, 1.0, 1.0);
  }

  MpQp finish() {
    const Index n = mpqp_.H.rows();
    if (soft_) add_row(RowVectorXd::Zero(n - 1), RowVectorXd::Zero(parameters_), 0.0, 1.0);
    const Index rows = std::ssize(rows_);
    mpqp_.G.resize(rows, n);
    mpqp_.S.resize(rows, parameters_);
    mpqp_.w.resize(rows);
    for (Index i = 0; i < rows; ++i) {
      const Row& row = rows_[static_cast<std::size_t>(i)];
      mpqp_.G.row(i) = row.moves;
      mpqp_.S.row(i) = row.parameters;
      mpqp_.w(i) = row.bound;
    }
    mpqp_.H = (0.5 * (mpqp_.H + mpqp_.H.transpose())).eval();
    return std::move(mpqp_);
  }

 private:
  struct Row {
    RowVectorXd moves, parameters;
    double bound;
  };

  // a·U + b·p ≤ bound + slack·s
  void add_row(const RowVectorXd& a, const RowVectorXd& b, double bound, double slack) {
    Row row{RowVectorXd::Zero(mpqp_.H.rows()), -b, bound};
    row.moves.head(a.size()) = a;
    if (soft_) row.moves.tail(1)(0) = -slack;
    rows_.push_back(std::move(row));
  }

  bool soft_;
  Index parameters_;
  MpQp mpqp_;
  std::vector<Row> rows_;
};

RowVectorXd unit_row(Index size, Index at) { return RowVectorXd::Unit(size, at); }

void check_horizons(const ControlProblem& problem) {
  if (problem.control_horizon < 1 || problem.control_horizon > problem.horizon) {
    throw DesignError("control.control_horizon must lie between 1 and control.horizon");
  }
  if (problem.stage_step < 1) throw DesignError("constraints.stage_step must be at least 1");
  if (problem.tightening.rows() != problem.horizon + 1 || problem.tightening.cols() != 2) {
    throw DesignError("the tightening must have one row for each stage 0..horizon");
  }
}

bool is_bounded(const ControlProblem& problem, int stage) {
  return (problem.horizon - stage) % problem.stage_step == 0;
}

// The box must have one finite interval per parameter: the law is defined on it and nowhere else.
void check_box(const ControlProblem& problem, Index parameters) {
  if (problem.lower.size() != parameters || problem.upper.size() != parameters ||
      !problem.lower.allFinite() || !problem.upper.allFinite() ||
      (problem.upper - problem.lower).minCoeff() <= 0.0) {
    throw DesignError("the parameter box needs a finite, non-empty interval for each parameter");
  }
}

CondensedProblem finish(ProblemBuilder& builder) {
  CondensedProblem condensed;
  condensed.mpqp = builder.finish();
  condensed.output_U = VectorXd::Unit(condensed.mpqp.H.rows(), 0);
  condensed.output_p = VectorXd::Zero(condensed.mpqp.F.cols());
  return condensed;
}

}  // namespace

CondensedProblem paper_problem(const SampledModel& model, const ControlProblem& problem) {
  if (model.A_star.rows() != 2) {
    throw DesignError(
        "control.formulation = \"paper\" knows no valve state; remove model.valve_time_constant_s "
        "or use control.formulation = \"tracking\"");
  }
  check_horizons(problem);
  const Index moves = problem.control_horizon;
  const Index parameters = problem.reference_is_parameter ? 5 : 4;
  check_box(problem, parameters);
  const auto disturbance = [&](Index row) {
    RowVectorXd of_parameters = RowVectorXd::Zero(parameters);
    of_parameters.segment<2>(2) = model.D.row(row);
    return of_parameters;
  };

  ProblemBuilder builder(moves, parameters, problem);
  Prediction x{MatrixXd::Zero(2, moves), MatrixXd::Identity(2, parameters)};
  const MatrixXd Q = MatrixXd::Constant(1, 1, problem.weight_angle);
  const MatrixXd R = MatrixXd::Constant(1, 1, problem.weight_control);
  const RowVectorXd reference = problem.reference_is_parameter
                                    ? unit_row(parameters, 4)
                                    : RowVectorXd(RowVectorXd::Zero(parameters));
  const VectorXd fixed_reference =
      VectorXd::Constant(1, problem.reference_is_parameter ? 0.0 : problem.fixed_reference_rad);

  for (int i = 0; i < problem.horizon; ++i) {
    const RowVectorXd move = unit_row(moves, std::min<Index>(i, moves - 1));
    builder.add_cost(R, move, RowVectorXd::Zero(parameters), VectorXd::Zero(1));
    if (i < problem.control_horizon) {
      builder.add_input_bound(move, RowVectorXd::Zero(parameters), problem.control_max);
    }
    x.of_moves = (model.A_star * x.of_moves + model.B_star * move).eval();
    x.of_parameters = (model.A_star * x.of_parameters).eval();
    for (Index j = 0; j < 2; ++j) x.of_parameters.row(j) += disturbance(j);

    // y_i = C x_i for i = 1..N; i = 0 is a constant.
    builder.add_cost(Q, x.of_moves.row(0), x.of_parameters.row(0) - reference, -fixed_reference);
    if (!is_bounded(problem, i + 1)) continue;
    const double bounds[] = {problem.angle_max_rad, problem.velocity_max_rad_s};
    for (Index j = 0; j < 2; ++j) {
      builder.add_state_bound(x.of_moves.row(j), x.of_parameters.row(j),
                              bounds[j] - problem.tightening(i + 1, j));
    }
  }
  return finish(builder);
}

CondensedProblem tracking_problem(const SampledModel& model, const ControlProblem& problem) {
  check_horizons(problem);
  const Index order = model.A_star.rows();
  const Index moves = problem.control_horizon;
  const Index parameters = order + 3;
  const Index at_u_ss = order;
  const Index at_reference = order + 1;
  const Index at_reference_velocity = order + 2;
  check_box(problem, parameters);

  VectorXd weights = VectorXd::Zero(order);
  weights.head<2>() << problem.weight_angle, problem.weight_velocity;
  const MatrixXd Q = weights.asDiagonal();
  const MatrixXd R = MatrixXd::Constant(1, 1, problem.weight_control);
  const MatrixXd R_delta = MatrixXd::Constant(1, 1, problem.weight_control_rate);
  const MatrixXd P = riccati_solution(model.A_star, model.B_star, Q, R);
  const RowVectorXd none = RowVectorXd::Zero(parameters);
  const VectorXd zero = VectorXd::Zero(1);

  ProblemBuilder builder(moves, parameters, problem);
  Prediction e{MatrixXd::Zero(order, moves), MatrixXd::Identity(order, parameters)};
  for (int i = 0; i < problem.horizon; ++i) {
    e.of_moves = (model.A_star * e.of_moves).eval();
    e.of_parameters = (model.A_star * e.of_parameters).eval();
    if (i < problem.control_horizon) {
      const RowVectorXd move = unit_row(moves, i);
      e.of_moves += model.B_star * move;
      builder.add_cost(R, move, none, zero);
      if (i > 0) builder.add_cost(R_delta, move - unit_row(moves, i - 1), none, zero);
      builder.add_input_bound(move, unit_row(parameters, at_u_ss), problem.control_max);
    }
    const int stage = i + 1;
    builder.add_cost(stage == problem.horizon ? P : Q, e.of_moves, e.of_parameters,
                     VectorXd::Zero(order));

    if (!is_bounded(problem, stage)) continue;
    // θ_i = e1_i + y_r + i T ẏ_r and θ̇_i = e2_i + ẏ_r.
    RowVectorXd angle = e.of_parameters.row(0);
    angle(at_reference) += 1.0;
    angle(at_reference_velocity) += stage * model.period_s;
    RowVectorXd velocity = e.of_parameters.row(1);
    velocity(at_reference_velocity) += 1.0;
    builder.add_state_bound(e.of_moves.row(0), angle,
                            problem.angle_max_rad - problem.tightening(stage, 0));
    builder.add_state_bound(e.of_moves.row(1), velocity,
                            problem.velocity_max_rad_s - problem.tightening(stage, 1));
  }
  // The move after the last free one is V = 0.
  if (problem.control_horizon < problem.horizon) {
    builder.add_cost(R_delta, unit_row(moves, moves - 1), none, zero);
  }

  CondensedProblem condensed = finish(builder);
  condensed.output_p(at_u_ss) = 1.0;
  return condensed;
}

}  // namespace eampc::law_design
