#include "law_design/invariant_set.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>
#include <stdexcept>
#include <utility>

#include "law_design/linear_program.hpp"
#include "law_design/region_certificate.hpp"

namespace eampc::law_design {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::RowVectorXd;
using Eigen::VectorXd;

// A row is implied if it holds with this to spare; the programs are exact to a tenth of it.
constexpr double kSpare = 1e-10;
constexpr int kMostSteps = 5000;

// The loop in one region, in q: x⁺ = M_x (x, r) + m + w.
struct ScaledLoop {
  MatrixXd M;  // np×np
  VectorXd m;  // np
  VectorXd disturbance, equilibrium_of_centre;
  MatrixXd steady;  // nx×nr: equilibrium x = steady·r + steady_0
  VectorXd steady_0;
  double spectral_radius = 0.0;
};

ScaledLoop scaled_loop(const CertificateProblem& problem, const ClosedLoop& loop,
                       const AffineForm& output, double y_min) {
  const Index np = problem.parameters;
  const Index nx = loop.A.rows();
  // u = range·y + y_min = g·q + g_0; p = centre + half_width·q.
  RowVectorXd g(np);
  for (Index j = 0; j < np; ++j) {
    g(j) = problem.output_range * output[static_cast<std::size_t>(j)];
  }
  const double g_0 = problem.output_range * output[static_cast<std::size_t>(np)] + y_min;
  const MatrixXd h = problem.half_width.asDiagonal();
  MatrixXd of_p(nx, np);
  of_p << loop.A, loop.A_parameters;
  of_p -= loop.B * loop.input_offset.transpose();
  const VectorXd inverse = problem.half_width.head(nx).cwiseInverse();
  ScaledLoop s;
  s.M = MatrixXd::Identity(np, np);
  s.M.topRows(nx) = inverse.asDiagonal() * (of_p * h + loop.B * g);
  s.m = VectorXd::Zero(np);
  s.m.head(nx) =
      inverse.cwiseProduct(of_p * problem.centre + loop.B * g_0 - problem.centre.head(nx));
  s.disturbance = inverse.cwiseProduct(loop.disturbance);
  const MatrixXd A = s.M.topLeftCorner(nx, nx);
  s.spectral_radius = A.eigenvalues().cwiseAbs().maxCoeff();
  const Eigen::PartialPivLU<MatrixXd> rest(MatrixXd::Identity(nx, nx) - A);
  s.steady = rest.solve(s.M.topRightCorner(nx, np - nx));
  s.steady_0 = rest.solve(s.m.head(nx));
  return s;
}

class SetBuilder {
 public:
  explicit SetBuilder(int np) : rows_(np), program_(np) {}

  /// Adds a·q ≤ b unless it is implied; returns true if it was added. False `*possible`: no q.
  bool add(const RowVectorXd& a, double b, bool* possible) {
    const double norm = a.norm();
    if (norm < 1e-13) {
      if (b < 0.0) *possible = false;
      return false;
    }
    const RowVectorXd unit = a / norm;
    const double offset = b / norm;
    const LpResult most = program_.maximise(unit.data(), rows_, offset - kSpare);
    if (most.status == LpStatus::kInfeasible) *possible = false;
    if (most.status == LpStatus::kBelowCutoff || most.status == LpStatus::kInfeasible ||
        (most.status == LpStatus::kOptimal && most.value <= offset - kSpare)) {
      return false;
    }
    rows_.append(unit.data(), offset);
    return true;
  }

  /// The rows that are not implied by the others.
  HalfSpaces irredundant() {
    HalfSpaces kept(rows_.dimension());
    std::vector<bool> needed(static_cast<std::size_t>(rows_.size()), true);
    std::vector<double> a(static_cast<std::size_t>(rows_.dimension()));
    for (int i = 0; i < rows_.size(); ++i) {
      HalfSpaces others(rows_.dimension());
      for (int k = 0; k < rows_.size(); ++k) {
        if (k == i || !needed[static_cast<std::size_t>(k)]) continue;
        rows_.copy_normal(k, a.data());
        others.append(a.data(), rows_.offset(k));
      }
      rows_.copy_normal(i, a.data());
      // A tenth of what the rows have to spare.
      const double limit = rows_.offset(i) + 0.1 * kSpare;
      const LpResult most = program_.maximise(a.data(), others, limit);
      needed[static_cast<std::size_t>(i)] =
          most.status == LpStatus::kFailed ||
          (most.status == LpStatus::kOptimal && most.value > limit);
      if (needed[static_cast<std::size_t>(i)]) kept.append(a.data(), rows_.offset(i));
    }
    return kept;
  }

 private:
  HalfSpaces rows_;
  LinearProgram program_;
};

void measure(const HalfSpaces& set, int samples, unsigned seed, InvariantSet& result) {
  result.box_scaling = 1.0;
  for (int i = 0; i < set.size(); ++i) {
    double reach = 0.0;
    for (int j = 0; j < set.dimension(); ++j) reach += std::abs(set.normal(i, j));
    result.box_scaling = std::min(result.box_scaling, set.offset(i) / reach);
  }
  result.box_scaling = std::max(result.box_scaling, 0.0);
  std::mt19937 random(seed);
  std::vector<double> q(static_cast<std::size_t>(set.dimension()));
  int inside = 0;
  for (int i = 0; i < samples; ++i) {
    for (double& x : q) x = 2.0 * static_cast<double>(random()) / 4294967295.0 - 1.0;
    inside += set.contains(q.data(), 0.0) ? 1 : 0;
  }
  result.samples = samples;
  result.volume_fraction = samples > 0 ? static_cast<double>(inside) / samples : 0.0;
}

void check(const MpQp& problem, const ClosedLoop& loop) {
  const Index np = problem.lower.size();
  const Index nx = loop.A.rows();
  if (loop.A.cols() != nx || nx < 1 || nx > np || loop.B.size() != nx ||
      loop.A_parameters.rows() != nx || loop.A_parameters.cols() != np - nx ||
      loop.input_offset.size() != np || loop.bound_rows.rows() != loop.bounds.size() ||
      loop.bound_rows.cols() != np || loop.disturbance.size() != nx) {
    throw std::invalid_argument("invariant set: the shapes of the loop do not fit the problem");
  }
}

}  // namespace

InvariantSet invariant_set(const MpQp& given, const OutputLaw& output,
                           const std::vector<std::vector<int>>& active_sets, const ClosedLoop& loop,
                           int samples, unsigned seed) {
  check(given, loop);
  const CertificateProblem problem = certificate_problem(given, output);
  const int np = problem.parameters;
  const Index nx = loop.A.rows();
  InvariantSet result;
  result.set = HalfSpaces(np);

  // The region around its own equilibrium, with the parameters r in the middle of their box.
  RegionCertifier certifier(problem);
  CertifiedRegion home;
  ScaledLoop best;
  double deepest = 0.0;
  for (const std::vector<int>& active : active_sets) {
    CertifiedRegion region;
    if (!certifier.solve(active, region)) continue;
    const ScaledLoop scaled = scaled_loop(problem, loop, region.output, output.y_min);
    if (!(scaled.spectral_radius < 1.0)) continue;
    VectorXd q = VectorXd::Zero(np);
    q.head(nx) = scaled.steady_0;
    if (q.lpNorm<Eigen::Infinity>() >= 1.0) continue;
    if (!certifier.certify(active, 1e-9, region)) continue;
    double depth = 1.0;
    for (int i = 0; i < region.polytope.facets.size(); ++i) {
      depth = std::min(
          depth, region.polytope.facets.offset(i) - region.polytope.facets.product(i, q.data()));
    }
    if (depth <= deepest) continue;
    deepest = depth;
    home = std::move(region);
    best = scaled;
  }
  if (deepest <= 0.0) {
    result.statement =
        "no set is certified: no region holds an equilibrium of its own stable loop at the centre "
        "of the parameters";
    return result;
  }
  result.spectral_radius = best.spectral_radius;

  std::vector<RowVectorXd> rows;
  std::vector<double> right;
  const auto require = [&](const RowVectorXd& a, double b) {
    rows.push_back(a);
    right.push_back(b);
  };
  for (int i = 0; i < home.polytope.facets.size(); ++i) {
    RowVectorXd a(np);
    home.polytope.facets.copy_normal(i, a.data());
    require(a, home.polytope.facets.offset(i));
  }
  const RowVectorXd y = Eigen::Map<const RowVectorXd>(home.output.data(), np);
  require(y, 1.0 - home.output[static_cast<std::size_t>(np)]);
  require(-y, home.output[static_cast<std::size_t>(np)]);
  for (int side = 0; side < 2 * np; ++side) {
    require((side % 2 == 0 ? 1.0 : -1.0) * RowVectorXd::Unit(np, side / 2), 1.0);
  }
  for (Index i = 0; i < loop.bounds.size(); ++i) {
    const RowVectorXd a = loop.bound_rows.row(i) * problem.half_width.asDiagonal();
    require(a, loop.bounds(i) - loop.bound_rows.row(i).dot(problem.centre));
  }

  SetBuilder builder(np);
  bool possible = true;
  // k → ∞: the support of the disturbance summed to its limit, bounded by what is left of it.
  std::vector<RowVectorXd> power = rows;
  const double limit = 1e-12;
  // A row over r alone holds for ever if it holds once.
  const auto contracts = [&](std::size_t i) { return !rows[i].head(nx).isZero(0.0); };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!contracts(i)) continue;
    double loss = 0.0;
    RowVectorXd a = rows[i].head(nx);
    const MatrixXd A = best.M.topLeftCorner(nx, nx);
    for (int k = 0; k < 100000 && a.lpNorm<Eigen::Infinity>() > limit; ++k) {
      loss += a.cwiseAbs().dot(best.disturbance);
      a = (a * A).eval();
    }
    RowVectorXd at_rest = RowVectorXd::Zero(np);
    at_rest.tail(np - nx) = rows[i].tail(np - nx) + rows[i].head(nx) * best.steady;
    const double b = right[i] - rows[i].head(nx).dot(best.steady_0) - loss -
                     InvariantSet::kMargin * rows[i].norm();
    builder.add(at_rest, b, &possible);
  }
  bool added = true;
  for (int k = 0; added && possible; ++k) {
    if (k >= kMostSteps) {
      result.statement = "no set is certified: it was not finitely determined in " +
                         std::to_string(kMostSteps) + " steps";
      return result;
    }
    added = false;
    for (std::size_t i = 0; i < rows.size() && possible; ++i) {
      if (k > 0 && !contracts(i)) continue;
      added = builder.add(power[i], right[i], &possible) || added;
      // a·M^k p ≤ b  →  a·M^k (M p + m + w) ≤ b
      right[i] -= power[i].dot(best.m) + power[i].head(nx).cwiseAbs().dot(best.disturbance);
      power[i] = (power[i] * best.M).eval();
    }
    result.steps = k;
  }
  if (!possible) {
    result.statement =
        "no set is certified: with the disturbance assumed, the set in which the loop stays for "
        "all time is empty";
    return result;
  }
  result.found = true;
  result.set = builder.irredundant();
  measure(result.set, samples, seed, result);
  result.statement =
      "from every point of the set the loop stays in one region and within all bounds for all "
      "time, whatever the disturbance does within its bound, while reference and disturbance "
      "estimate are constant";
  return result;
}

}  // namespace eampc::law_design
