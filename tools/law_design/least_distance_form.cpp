#include "law_design/least_distance_form.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>
#include <stdexcept>
#include <string>

#include "law_design/linear_program.hpp"

namespace eampc::law_design {
namespace {

using RowMatrix = LeastDistanceForm::RowMatrix;

// Rows are reduced within this multiple of the largest optimal z seen, where no bound is proved.
constexpr double kGuessedBound = 100.0;
// A row that cuts off less than this of the others' joint (z, q) polytope is redundant.
constexpr double kCut = 1e-10;

void require(bool condition, const std::string& sentence) {
  if (!condition) throw std::invalid_argument(sentence);
}

void check(const MpQp& problem) {
  const Eigen::Index n = problem.H.rows();
  const Eigen::Index np = problem.lower.size();
  const Eigen::Index m = problem.G.rows();
  require(n > 0 && problem.H.cols() == n, "mpQP: H must be square and not empty");
  require(np > 0 && np <= 8, "mpQP: between 1 and 8 parameters are supported");
  require(problem.F.rows() == n && problem.F.cols() == np, "mpQP: F must be n×np");
  require(problem.f.size() == n, "mpQP: f must have n entries");
  require(problem.G.cols() == n, "mpQP: G must have n columns");
  require(problem.w.size() == m, "mpQP: w must have as many entries as G has rows");
  require(problem.S.rows() == m && problem.S.cols() == np, "mpQP: S must be m×np");
  require(problem.upper.size() == np, "mpQP: lower and upper must have np entries");
  require(problem.H.allFinite() && problem.F.allFinite() && problem.f.allFinite() &&
              problem.G.allFinite() && problem.w.allFinite() && problem.S.allFinite() &&
              problem.lower.allFinite() && problem.upper.allFinite(),
          "mpQP: every number must be finite");
  require((problem.upper - problem.lower).minCoeff() > 0.0,
          "mpQP: every parameter needs lower < upper; leave out a parameter that is fixed");
}

void split_parameter_rows(const MpQp& problem, const RowMatrix& whitened, LeastDistanceForm& form,
                          std::vector<int>& kept) {
  const double largest = std::max(whitened.rowwise().norm().maxCoeff(), 1e-300);
  for (int i = 0; i < whitened.rows(); ++i) {
    if (whitened.row(i).norm() > 1e-12 * largest) {
      kept.push_back(i);
      continue;
    }
    Eigen::VectorXd a = -problem.S.row(i).transpose().cwiseProduct(form.half_width);
    double b = problem.w(i) + problem.S.row(i).dot(form.centre);
    const double norm = a.norm();
    if (norm <= 1e-12 * (std::abs(b) + problem.S.row(i).norm())) {
      require(b >= -1e-12 * std::abs(problem.w(i)),
              "mpQP: row " + std::to_string(i) + " of G U <= w + S p is never satisfied");
      continue;
    }
    a /= norm;
    b /= norm;
    require(-a.lpNorm<1>() <= b,
            "mpQP: row " + std::to_string(i) + " excludes the whole parameter box");
    if (a.lpNorm<1>() <= b) continue;
    form.parameter_rows.append(a.data(), b);
    form.parameter_row_origin.push_back(i);
  }
}

// Largest ‖z‖ over the corners and some random points of the box. Where all corners are feasible
// it bounds every optimum: ½‖z*(q)‖² is the optimal value of a problem jointly convex in (z, q),
// hence convex in q.
double largest_optimum(LeastDistanceForm& form, bool& proved) {
  LeastDistanceProgram program(form.rows, form.tolerances);
  std::vector<int> active;
  Eigen::VectorXd q(form.parameters);
  Eigen::VectorXd d(form.rows.rows());
  double largest = 0.0;
  proved = true;
  const auto visit = [&](bool keep) {
    form.right_side(q.data(), d.data());
    if (program.solve(d.data(), active) != QpStatus::kOptimal) {
      active.clear();
      if (program.solve(d.data(), active) != QpStatus::kOptimal) return false;
    }
    largest =
        std::max(largest, Eigen::Map<const Eigen::VectorXd>(program.z(), form.variables).norm());
    if (keep && form.parameter_rows.contains(q.data(), 0.0)) form.feasible_points.push_back(q);
    return true;
  };
  q.setZero();
  visit(true);
  for (int corner = 0; corner < (1 << form.parameters); ++corner) {
    for (int j = 0; j < form.parameters; ++j) q(j) = ((corner >> j) & 1) != 0 ? 1.0 : -1.0;
    proved &= visit(false);
  }
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int i = 0; i < 50; ++i) {
    for (int j = 0; j < form.parameters; ++j) q(j) = uniform(random);
    visit(true);
  }
  form.qps += program.count();
  return largest;
}

// A parameter where the problem is feasible with some margin, by one linear program.
void find_feasible_point(LeastDistanceForm& form) {
  const int n = form.variables;
  const int np = form.parameters;
  LinearProgram program(n + np + 1);
  for (int j = 0; j < n; ++j) program.set_bounds(j, -1e6, 1e6);
  HalfSpaces rows(n + np + 1);
  std::vector<double> a(static_cast<std::size_t>(n + np + 1), 0.0);
  for (Eigen::Index i = 0; i < form.rows.rows(); ++i) {
    for (int j = 0; j < n; ++j) a[static_cast<std::size_t>(j)] = form.rows(i, j);
    for (int j = 0; j < np; ++j) a[static_cast<std::size_t>(n + j)] = -form.bounds(i, j);
    a.back() = 1.0;
    rows.append(a.data(), form.bounds(i, np));
  }
  for (int i = 0; i < form.parameter_rows.size(); ++i) {
    std::fill(a.begin(), a.end(), 0.0);
    form.parameter_rows.copy_normal(i, a.data() + n);
    a.back() = 1.0;
    rows.append(a.data(), form.parameter_rows.offset(i));
  }
  std::fill(a.begin(), a.end(), 0.0);
  a.back() = 1.0;
  const LpResult result = program.maximise(a.data(), rows, 1e-9);
  ++form.lps;
  require(result.status == LpStatus::kOptimal,
          "mpQP: no parameter of the box has a feasible solution; widen the bounds");
  form.feasible_points.push_back(Eigen::Map<const Eigen::VectorXd>(program.point() + n, np));
}

std::vector<int> irredundant_rows(LeastDistanceForm& form) {
  const int n = form.variables;
  const int np = form.parameters;
  const int m = static_cast<int>(form.rows.rows());
  LinearProgram program(n + np);
  for (int j = 0; j < n; ++j) program.set_bounds(j, -form.z_bound, form.z_bound);
  HalfSpaces joint(n + np);
  std::vector<double> offsets;
  Eigen::VectorXd a(n + np);
  std::vector<double> reach;
  for (int i = 0; i < m; ++i) {
    a.head(n) = form.rows.row(i).transpose();
    a.tail(np) = -form.bounds.row(i).head(np).transpose();
    const double norm = a.norm();
    a /= norm;
    offsets.push_back(form.bounds(i, np) / norm);
    joint.append(a.data(), offsets.back());
  }
  for (int i = 0; i < form.parameter_rows.size(); ++i) {
    a.setZero();
    form.parameter_rows.copy_normal(i, a.data() + n);
    joint.append(a.data(), form.parameter_rows.offset(i));
  }
  std::vector<int> kept;
  for (int i = 0; i < m; ++i) {
    joint.copy_normal(i, a.data());
    const double offset = offsets[static_cast<std::size_t>(i)];
    joint.set_offset(i, 1e30);
    const LpResult result = program.maximise(a.data(), joint, offset + kCut);
    if (result.status == LpStatus::kBelowCutoff || result.status == LpStatus::kInfeasible ||
        (result.status == LpStatus::kOptimal && result.value <= offset + kCut)) {
      continue;
    }
    joint.set_offset(i, offset);
    kept.push_back(i);
  }
  form.lps += program.count();
  return kept;
}

void set_tolerances(LeastDistanceForm& form) {
  form.tolerances.clear();
  for (Eigen::Index i = 0; i < form.rows.rows(); ++i) {
    form.tolerances.push_back(1e-12 * (1.0 + form.bounds.row(i).norm()));
  }
}

void keep_rows(LeastDistanceForm& form, const std::vector<int>& kept) {
  RowMatrix rows(static_cast<Eigen::Index>(kept.size()), form.variables);
  RowMatrix bounds(static_cast<Eigen::Index>(kept.size()), form.parameters + 1);
  std::vector<int> original;
  for (std::size_t k = 0; k < kept.size(); ++k) {
    rows.row(static_cast<Eigen::Index>(k)) = form.rows.row(kept[k]);
    bounds.row(static_cast<Eigen::Index>(k)) = form.bounds.row(kept[k]);
    original.push_back(form.original_rows[static_cast<std::size_t>(kept[k])]);
  }
  form.rows = std::move(rows);
  form.bounds = std::move(bounds);
  form.original_rows = std::move(original);
  set_tolerances(form);
}

}  // namespace

void LeastDistanceForm::right_side(const double* q, double* d) const {
  for (Eigen::Index i = 0; i < bounds.rows(); ++i) {
    const double* row = bounds.data() + i * bounds.cols();
    double sum = row[parameters];
    for (int j = 0; j < parameters; ++j) sum += row[j] * q[j];
    d[i] = sum;
  }
}

LeastDistanceForm to_least_distance_form(const MpQp& problem) {
  check(problem);
  LeastDistanceForm form;
  form.variables = static_cast<int>(problem.H.rows());
  form.parameters = static_cast<int>(problem.lower.size());
  const int np = form.parameters;
  form.centre = 0.5 * (problem.lower + problem.upper);
  form.half_width = 0.5 * (problem.upper - problem.lower);
  form.parameter_rows = HalfSpaces(np);

  const Eigen::LLT<Eigen::MatrixXd> factor(0.5 * (problem.H + problem.H.transpose()));
  require(factor.info() == Eigen::Success, "mpQP: H must be positive definite");
  const Eigen::MatrixXd lower = factor.matrixL();
  // Linear term and right side as functions of (q, 1).
  Eigen::MatrixXd linear(form.variables, np + 1);
  linear.leftCols(np) = problem.F * form.half_width.asDiagonal();
  linear.col(np) = problem.f + problem.F * form.centre;
  Eigen::MatrixXd right(problem.G.rows(), np + 1);
  right.leftCols(np) = problem.S * form.half_width.asDiagonal();
  right.col(np) = problem.w + problem.S * form.centre;
  right += problem.G * factor.solve(linear);

  const Eigen::MatrixXd whitened_columns =
      lower.triangularView<Eigen::Lower>().solve(problem.G.transpose());
  const RowMatrix whitened = whitened_columns.transpose();
  std::vector<int> kept;
  if (whitened.rows() > 0) split_parameter_rows(problem, whitened, form, kept);
  form.rows.resize(static_cast<Eigen::Index>(kept.size()), form.variables);
  form.bounds.resize(static_cast<Eigen::Index>(kept.size()), np + 1);
  for (std::size_t k = 0; k < kept.size(); ++k) {
    const double norm = whitened.row(kept[k]).norm();
    form.rows.row(static_cast<Eigen::Index>(k)) = whitened.row(kept[k]) / norm;
    form.bounds.row(static_cast<Eigen::Index>(k)) = right.row(kept[k]) / norm;
  }
  form.original_rows = kept;
  set_tolerances(form);

  bool all_corners = false;
  double scale = largest_optimum(form, all_corners);
  if (!(scale > 0.0)) {
    scale = form.bounds.size() > 0 ? std::max(form.bounds.cwiseAbs().maxCoeff(), 1e-300) : 1.0;
  }
  form.bounds /= scale;
  set_tolerances(form);
  form.back = scale * lower.transpose().triangularView<Eigen::Upper>().solve(
                          Eigen::MatrixXd::Identity(form.variables, form.variables));
  form.shift = -factor.solve(linear);
  if (form.feasible_points.empty()) find_feasible_point(form);
  form.z_bound_proved = all_corners;
  form.z_bound = all_corners ? 1.0 + 1e-6 : kGuessedBound;
  keep_rows(form, irredundant_rows(form));
  return form;
}

}  // namespace eampc::law_design
