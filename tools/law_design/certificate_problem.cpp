#include "law_design/certificate_problem.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "law_design/polytope.hpp"

namespace eampc::law_design {
namespace {

using Eigen::Index;

void require(bool condition, const char* sentence) {
  if (!condition) throw std::invalid_argument(sentence);
}

void check(const MpQp& p, const OutputLaw& output) {
  const Index n = p.H.rows();
  const Index np = p.lower.size();
  const Index m = p.G.rows();
  require(n >= 1 && p.H.cols() == n && p.F.rows() == n && p.f.size() == n && p.G.cols() == n &&
              p.F.cols() == np && p.S.rows() == m && p.S.cols() == np && p.w.size() == m &&
              p.upper.size() == np && output.Y_U.size() == n && output.Y_p.size() == np,
          "certificate: the shapes of the problem do not fit together");
  require(np >= 1 && np <= kMaxDimension, "certificate: a law has 1 to 8 parameters");
  require(p.H.allFinite() && p.F.allFinite() && p.f.allFinite() && p.G.allFinite() &&
              p.w.allFinite() && p.S.allFinite() && p.lower.allFinite() && p.upper.allFinite() &&
              output.Y_U.allFinite() && output.Y_p.allFinite() && std::isfinite(output.y_0),
          "certificate: the problem holds a number that is not finite");
  require((p.upper - p.lower).minCoeff() > 0.0, "certificate: the parameter box is empty");
  require(output.y_max > output.y_min && std::isfinite(output.y_max - output.y_min),
          "certificate: the range of the output is empty");
}

// Rows (A h, A c + b) of p ↦ A p + b as a function of (q, 1).
ExtendedMatrix scaled(const Eigen::MatrixXd& A, const Eigen::VectorXd& b,
                      const CertificateProblem& problem) {
  const Index np = problem.parameters;
  ExtendedMatrix result(A.rows(), np + 1);
  for (Index i = 0; i < A.rows(); ++i) {
    long double constant = b(i);
    for (Index j = 0; j < np; ++j) {
      result(i, j) = static_cast<long double>(A(i, j)) * problem.half_width(j);
      constant += static_cast<long double>(A(i, j)) * problem.centre(j);
    }
    result(i, np) = constant;
  }
  return result;
}

bool same_row(const CertificateProblem& problem, int i, int k) {
  constexpr long double kSame = 1e-16L;
  const long double size = std::max(problem.D.row(k).cwiseAbs().maxCoeff(), 1.0L);
  return problem.norms[static_cast<std::size_t>(i)] > 0.0L &&
         problem.norms[static_cast<std::size_t>(k)] > 0.0L &&
         (problem.M.row(i) - problem.M.row(k)).cwiseAbs().maxCoeff() <= kSame &&
         (problem.D.row(i) - problem.D.row(k)).cwiseAbs().maxCoeff() <= kSame * size;
}

}  // namespace

CertificateProblem certificate_problem(const MpQp& given, const OutputLaw& output) {
  check(given, output);
  CertificateProblem problem;
  problem.variables = static_cast<int>(given.H.rows());
  problem.parameters = static_cast<int>(given.lower.size());
  problem.rows = static_cast<int>(given.G.rows());
  problem.centre = 0.5 * (given.lower + given.upper);
  problem.half_width = 0.5 * (given.upper - given.lower);
  const double asymmetry = (given.H - given.H.transpose()).cwiseAbs().maxCoeff();
  require(asymmetry <= 1e-12 * given.H.cwiseAbs().maxCoeff(),
          "certificate: H is not symmetric, so the optimality conditions do not hold as stated");
  problem.H = given.H.cast<long double>();
  problem.F = scaled(given.F, given.f, problem);
  problem.G = given.G.cast<long double>();
  problem.W = scaled(given.S, given.w, problem);
  problem.Y_U = output.Y_U.cast<long double>();
  problem.Y = scaled(output.Y_p, Eigen::VectorXd::Constant(1, output.y_0 - output.y_min), problem);
  problem.output_range = output.y_max - output.y_min;
  problem.Y_U /= static_cast<long double>(problem.output_range);
  problem.Y /= static_cast<long double>(problem.output_range);

  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(given.H, Eigen::EigenvaluesOnly);
  problem.smallest_eigenvalue = eigen.eigenvalues()(0);
  problem.largest_eigenvalue = eigen.eigenvalues()(problem.variables - 1);
  // The eigenvalues are exact to n ε times the largest.
  const double rounding = 10.0 * problem.variables * std::numeric_limits<double>::epsilon() *
                          problem.largest_eigenvalue;
  const Eigen::LLT<ExtendedMatrix> cholesky(problem.H);
  require(cholesky.info() == Eigen::Success && problem.smallest_eigenvalue > rounding,
          "certificate: H is not positive definite, so optimal inputs are not unique");
  problem.L = cholesky.matrixL();
  const ExtendedMatrix K = problem.L.triangularView<Eigen::Lower>().solve(problem.F);
  problem.M = problem.L.triangularView<Eigen::Lower>()
                  .solve(ExtendedMatrix(problem.G.transpose()))
                  .transpose();
  problem.D = problem.W + problem.M * K;
  problem.norms.assign(static_cast<std::size_t>(problem.rows), 0.0L);
  for (Index i = 0; i < problem.rows; ++i) {
    const long double norm = problem.M.row(i).norm();
    problem.norms[static_cast<std::size_t>(i)] = norm;
    if (norm == 0.0L) continue;
    problem.M.row(i) /= norm;
    problem.D.row(i) /= norm;
  }
  for (int i = 0; i < problem.rows; ++i) {
    int first = 0;
    while (first < i && !same_row(problem, i, first)) ++first;
    problem.first_equal.push_back(first);
  }
  return problem;
}

}  // namespace eampc::law_design
