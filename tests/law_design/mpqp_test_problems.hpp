// Multiparametric QPs with known difficulties, and the optimality certificate that judges them.
#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "law_design/mpqp.hpp"

namespace eampc::law_design::test {

/// How far U is from optimal at p, from the problem's own data alone: the KKT conditions are
/// sufficient for a convex problem. Multipliers are fitted to the active rows by non-negative
/// least squares (Lawson and Hanson), so no active set has to be known.
inline double optimality_gap(const MpQp& problem, const Eigen::VectorXd& p,
                             const Eigen::VectorXd& U) {
  const Eigen::VectorXd slack = problem.w + problem.S * p - problem.G * U;
  double gap = 0.0;
  std::vector<Eigen::Index> active;
  for (Eigen::Index i = 0; i < slack.size(); ++i) {
    const double norm = problem.G.row(i).norm();
    if (norm == 0.0) continue;
    gap = std::max(gap, -slack(i) / norm);
    if (slack(i) / norm < 1e-6) active.push_back(i);
  }
  const Eigen::VectorXd target = -(problem.H * U + problem.F * p + problem.f);
  Eigen::MatrixXd A(U.size(), static_cast<Eigen::Index>(active.size()));
  for (std::size_t k = 0; k < active.size(); ++k) {
    A.col(static_cast<Eigen::Index>(k)) = problem.G.row(active[k]).transpose();
  }
  Eigen::VectorXd x = Eigen::VectorXd::Zero(A.cols());
  std::vector<bool> passive(active.size(), false);
  for (Eigen::Index round = 0; round < 10 * A.cols(); ++round) {
    const Eigen::VectorXd pull = A.transpose() * (target - A * x);
    Eigen::Index best = -1;
    for (Eigen::Index k = 0; k < A.cols(); ++k) {
      if (!passive[static_cast<std::size_t>(k)] && (best < 0 || pull(k) > pull(best))) best = k;
    }
    if (best < 0 || pull(best) < 1e-13 * (1.0 + target.norm())) break;
    passive[static_cast<std::size_t>(best)] = true;
    while (true) {
      std::vector<Eigen::Index> set;
      for (Eigen::Index k = 0; k < A.cols(); ++k) {
        if (passive[static_cast<std::size_t>(k)]) set.push_back(k);
      }
      if (set.empty()) break;
      Eigen::MatrixXd columns(A.rows(), static_cast<Eigen::Index>(set.size()));
      for (std::size_t k = 0; k < set.size(); ++k) {
        columns.col(static_cast<Eigen::Index>(k)) = A.col(set[k]);
      }
      const Eigen::VectorXd fit = columns.completeOrthogonalDecomposition().solve(target);
      if (fit.minCoeff() > 0.0) {
        x.setZero();
        for (std::size_t k = 0; k < set.size(); ++k) x(set[k]) = fit(static_cast<Eigen::Index>(k));
        break;
      }
      double step = 1.0;
      for (std::size_t k = 0; k < set.size(); ++k) {
        const double to = fit(static_cast<Eigen::Index>(k));
        if (to <= 0.0) step = std::min(step, x(set[k]) / (x(set[k]) - to + 1e-300));
      }
      for (std::size_t k = 0; k < set.size(); ++k) {
        x(set[k]) += step * (fit(static_cast<Eigen::Index>(k)) - x(set[k]));
        if (fit(static_cast<Eigen::Index>(k)) <= 0.0 && x(set[k]) <= 1e-14) {
          x(set[k]) = 0.0;
          passive[static_cast<std::size_t>(set[k])] = false;
        }
      }
    }
  }
  // A gradient residual r moves the optimum by at most |H⁻¹ r|.
  const Eigen::VectorXd residual = target - A * x;
  return std::max(gap, problem.H.llt().solve(residual).norm());
}

/// The published benchmark: p = (x1, x2, s1, s2, r), track r with |u| ≤ 4, |x1| ≤ 1.6, |x2| ≤ 8 at
/// T = 10 ms; b1 is 106.875 for u0 = 2 and 0 (a singular A) for u0 = 0.
inline MpQp benchmark_p5(int N, double u0) {
  constexpr double kPeriod_s = 0.01;
  Eigen::Matrix2d A;
  A << 0.0, 1.0, 106.875 * u0 / 2.0, -5.0;
  // Series of e^{Aτ} and its integral: ‖A‖T ≈ 1, thirty terms leave 1e-33.
  Eigen::Matrix2d power = Eigen::Matrix2d::Identity();
  Eigen::Matrix2d transition = power;
  Eigen::Matrix2d integral = power * kPeriod_s;
  for (int k = 1; k <= 30; ++k) {
    power = power * A * (kPeriod_s / k);
    transition += power;
    integral += power * (kPeriod_s / (k + 1));
  }
  const Eigen::Vector2d input = integral * Eigen::Vector2d(0.0, 4.96125);
  const Eigen::Index n = N;
  MpQp problem;
  problem.H = 0.02 * Eigen::MatrixXd::Identity(n, n);
  problem.F = Eigen::MatrixXd::Zero(n, 5);
  problem.f = Eigen::VectorXd::Zero(n);
  problem.G = Eigen::MatrixXd::Zero(6 * n, n);
  problem.w = Eigen::VectorXd::Zero(6 * n);
  problem.S = Eigen::MatrixXd::Zero(6 * n, 5);
  problem.lower = -Eigen::VectorXd::Map(std::array{1.6, 8.0, 1.0, 5.0, 1.2}.data(), 5);
  problem.upper = -problem.lower;
  Eigen::MatrixXd on_u = Eigen::MatrixXd::Zero(2, n);
  Eigen::MatrixXd on_p = Eigen::MatrixXd::Zero(2, 5);
  on_p.leftCols(2).setIdentity();
  for (Eigen::Index i = 0; i < n; ++i) {
    on_u = (transition * on_u).eval();
    on_u.col(i) += input;
    on_p = (transition * on_p).eval();
    on_p.middleCols(2, 2) += integral;
    Eigen::RowVectorXd error = on_p.row(0);
    error(4) -= 1.0;
    problem.H += 200.0 * on_u.row(0).transpose() * on_u.row(0);
    problem.F += 200.0 * on_u.row(0).transpose() * error;
    const double bounds[2] = {1.6, 8.0};
    for (Eigen::Index j = 0; j < 2; ++j) {
      for (Eigen::Index side = 0; side < 2; ++side) {
        const double sign = side == 0 ? 1.0 : -1.0;
        const Eigen::Index row = 6 * i + 2 * j + side;
        problem.G.row(row) = sign * on_u.row(j);
        problem.w(row) = bounds[j];
        problem.S.row(row) = -sign * on_p.row(j);
      }
    }
    problem.G(6 * i + 4, i) = 1.0;
    problem.G(6 * i + 5, i) = -1.0;
    problem.w(6 * i + 4) = problem.w(6 * i + 5) = 4.0;
  }
  return problem;
}

/// u[0] of the benchmark, within ±4.
inline OutputLaw first_input(const MpQp& problem, double bound) {
  OutputLaw output;
  output.Y_U = Eigen::RowVectorXd::Zero(problem.H.rows());
  output.Y_U(0) = 1.0;
  output.Y_p = Eigen::RowVectorXd::Zero(problem.lower.size());
  output.y_min = -bound;
  output.y_max = bound;
  return output;
}

/// A chain of integrators with one to three inputs, input and state bounds, some rows given twice,
/// some redundant, some that bound parameters only.
inline MpQp degenerate_chain(unsigned seed) {
  std::mt19937 random(seed);
  const auto pick = [&](int low, int high) {
    return low + static_cast<int>(random() % static_cast<unsigned>(high - low + 1));
  };
  const Eigen::Index states = pick(2, 3);
  const Eigen::Index inputs = pick(1, static_cast<int>(states));
  const Eigen::Index horizon = inputs == 1 ? pick(2, 5) : 2;
  Eigen::MatrixXd A = Eigen::MatrixXd::Identity(states, states);
  for (Eigen::Index i = 0; i + 1 < states; ++i) A(i, i + 1) = 0.1 * pick(1, 10);
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(states, inputs);
  for (Eigen::Index j = 0; j < inputs; ++j) B(states - 1 - j, j) = 1.0;
  const Eigen::Index n = horizon * inputs;
  const double weight = std::pow(10.0, -pick(0, 3));
  MpQp problem;
  problem.H = weight * Eigen::MatrixXd::Identity(n, n);
  problem.F = Eigen::MatrixXd::Zero(n, states);
  problem.f = Eigen::VectorXd::Zero(n);
  problem.lower = Eigen::VectorXd::Constant(states, -3.0);
  problem.upper = -problem.lower;
  std::vector<Eigen::RowVectorXd> G, S;
  std::vector<double> w;
  const auto add = [&](const Eigen::RowVectorXd& g, double bound, const Eigen::RowVectorXd& s) {
    G.push_back(g);
    w.push_back(bound);
    S.push_back(s);
  };
  Eigen::MatrixXd on_u = Eigen::MatrixXd::Zero(states, n);
  Eigen::MatrixXd on_x = Eigen::MatrixXd::Identity(states, states);
  for (Eigen::Index i = 0; i < horizon; ++i) {
    for (Eigen::Index j = 0; j < inputs; ++j) {
      const Eigen::RowVectorXd unit = Eigen::RowVectorXd::Unit(n, i * inputs + j);
      add(unit, 1.0, Eigen::RowVectorXd::Zero(states));
      add(-unit, 1.0, Eigen::RowVectorXd::Zero(states));
    }
    on_u = (A * on_u).eval();
    on_u.middleCols(i * inputs, inputs) += B;
    on_x = (A * on_x).eval();
    problem.H += on_u.transpose() * on_u;
    problem.F += on_u.transpose() * on_x;
    for (Eigen::Index k = 0; k < states; ++k) {
      add(on_u.row(k), 2.5, -on_x.row(k));
      add(-on_u.row(k), 2.5, on_x.row(k));
    }
  }
  const std::size_t given = G.size();
  for (int copy = 0; copy < 4; ++copy) {
    const std::size_t row = random() % given;
    add(2.0 * G[row], 2.0 * w[row], 2.0 * S[row]);  // the same row, scaled
    add(G[row], w[row] + 0.5, S[row]);              // redundant
  }
  add(Eigen::RowVectorXd::Zero(n), 2.9, Eigen::RowVectorXd::Unit(states, 0));  // x0 ≥ −2.9
  problem.G.resize(static_cast<Eigen::Index>(G.size()), n);
  problem.S.resize(static_cast<Eigen::Index>(G.size()), states);
  problem.w.resize(static_cast<Eigen::Index>(G.size()));
  for (std::size_t i = 0; i < G.size(); ++i) {
    problem.G.row(static_cast<Eigen::Index>(i)) = G[i];
    problem.S.row(static_cast<Eigen::Index>(i)) = S[i];
    problem.w(static_cast<Eigen::Index>(i)) = w[i];
  }
  return problem;
}

inline Eigen::VectorXd random_parameter(const MpQp& problem, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  Eigen::VectorXd p(problem.lower.size());
  for (Eigen::Index j = 0; j < p.size(); ++j) {
    p(j) = problem.lower(j) + uniform(random) * (problem.upper(j) - problem.lower(j));
  }
  return p;
}

/// Index of a region that holds p to `tolerance`, or -1.
inline int region_at(const MpQpSolution& solution, const Eigen::VectorXd& p,
                     double tolerance = 1e-7) {
  for (std::size_t r = 0; r < solution.regions.size(); ++r) {
    const CriticalRegion& region = solution.regions[r];
    if ((region.facet_normals * p - region.facet_offsets).maxCoeff() <= tolerance) {
      return static_cast<int>(r);
    }
  }
  return -1;
}

}  // namespace eampc::law_design::test
