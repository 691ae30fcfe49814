#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>

#include "law_design/certificate_test_problems.hpp"
#include "law_design/coverage_certificate.hpp"
#include "law_design/law_certificate.hpp"
#include "law_design/mpqp_test_problems.hpp"
#include "law_design/polytope_volume.hpp"

namespace eampc::law_design {
namespace {

using Sets = std::vector<std::vector<int>>;

Sets active_sets(const MpQp& problem) {
  Sets sets;
  for (const CriticalRegion& region : solve_mpqp(problem).regions)
    sets.push_back(region.active_set);
  return sets;
}

LawCertificate certify(const MpQp& problem, const OutputLaw& output, const Sets& sets,
                       bool infeasible_allowed = false, int threads = 2) {
  LawCertificateOptions options;
  options.infeasible_allowed = infeasible_allowed;
  options.threads = threads;
  return certify_law(problem, output, sets, nullptr, options);
}

TEST(CertificateCoverage, ProvesALawKnownByHandInOneToThreeParameters) {
  for (const int np : {1, 2, 3}) {
    const MpQp problem = test::clipped_sum(np);
    const LawCertificate proof =
        certify(problem, test::only_input(problem), test::clipped_sum_sets());
    EXPECT_TRUE(proof.failure.empty()) << proof.failure;
    EXPECT_TRUE(proof.optimal && proof.covered && proof.continuous);
    EXPECT_EQ(proof.coverage.facets, 4);
    EXPECT_EQ(proof.coverage.matched, 4);
    EXPECT_NEAR(proof.coverage.volume, 1.0, 1e-14);
    EXPECT_EQ(proof.smallest_eigenvalue, 1.0);
  }
}

TEST(CertificateCoverage, NamesAMissingRegionAnOverlapAndAContradiction) {
  const MpQp problem = test::clipped_sum(2);
  const OutputLaw output = test::only_input(problem);
  const LawCertificate hole = certify(problem, output, {{0}, {1}});
  EXPECT_FALSE(hole.covered);
  EXPECT_NE(hole.failure.find("region of the active set {} is not in the list"), std::string::npos)
      << hole.failure;
  EXPECT_EQ(hole.coverage.uncovered, 2);
  EXPECT_FALSE(certify(problem, output, {{}, {0}, {1}, {1}}).covered);
  // Both bounds at once: no multipliers, an empty region behind {0}'s listing.
  const LawCertificate wrong = certify(problem, output, {{}, {0}});
  EXPECT_FALSE(wrong.covered);
  EXPECT_FALSE(certify(problem, output, {{}, {0}, {1}, {7}}).optimal);
  EXPECT_FALSE(certify(problem, output, {}).optimal);
}

TEST(CertificateCoverage, ProvesTheBenchmarksWithTheirInfeasibleParts) {
  for (const double u0 : {2.0, 0.0}) {
    for (const int N : {5, 10}) {
      const MpQp problem = test::benchmark_p5(N, u0);
      const OutputLaw output = test::first_input(problem, 4.0);
      const Sets sets = active_sets(problem);
      const LawCertificate proof = certify(problem, output, sets, true);
      EXPECT_TRUE(proof.failure.empty()) << proof.failure;
      EXPECT_GT(proof.coverage.infeasible_border, 0);
      EXPECT_LT(proof.regions.stationarity, 1e-15);
      EXPECT_LT(proof.coverage.jump, 1e-11);
      EXPECT_FALSE(certify(problem, output, sets).covered) << "infeasible parts are an error";
    }
  }
}

TEST(CertificateCoverage, FindsEachRegionThatIsTakenAway) {
  const MpQp problem = test::benchmark_p5(5, 2.0);
  const OutputLaw output = test::first_input(problem, 4.0);
  const Sets sets = active_sets(problem);
  for (std::size_t removed = 0; removed < sets.size(); ++removed) {
    Sets rest = sets;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(removed));
    EXPECT_FALSE(certify(problem, output, rest, true).covered) << removed;
  }
}

TEST(CertificateCoverage, FindsAWrongActiveSet) {
  const MpQp problem = test::benchmark_p5(5, 2.0);
  const OutputLaw output = test::first_input(problem, 4.0);
  Sets sets = active_sets(problem);
  const auto most = std::max_element(
      sets.begin(), sets.end(), [](const auto& a, const auto& b) { return a.size() < b.size(); });
  most->pop_back();
  EXPECT_FALSE(certify(problem, output, sets, true).failure.empty());
}

TEST(CertificateCoverage, ProvesDegenerateChainsWithEqualAndRedundantRows) {
  long infeasible = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    const MpQp problem = test::degenerate_chain(seed);
    const LawCertificate proof =
        certify(problem, test::first_input(problem, 1.0), active_sets(problem), true);
    EXPECT_TRUE(proof.failure.empty()) << "seed " << seed << ": " << proof.failure;
    infeasible += proof.coverage.infeasible_border;
  }
  EXPECT_GT(infeasible, 100);
}

// The nearest point to p with u1 ≤ 1, u2 ≤ 1 and the sum of both: beyond (1, 1) one solution has
// the active sets {0, 1}, and {0, 2} on one side of the diagonal, {1, 2} on the other.
MpQp nearest_in_a_corner() {
  MpQp problem;
  problem.H = Eigen::MatrixXd::Identity(2, 2);
  problem.F = -Eigen::MatrixXd::Identity(2, 2);
  problem.f = Eigen::VectorXd::Zero(2);
  problem.G.resize(3, 2);
  problem.G << 1.0, 0.0, 0.0, 1.0, 1.0, 1.0;
  problem.w = Eigen::Vector3d(1.0, 1.0, 2.0);
  problem.S = Eigen::MatrixXd::Zero(3, 2);
  problem.lower = Eigen::VectorXd::Constant(2, -2.0);
  problem.upper = Eigen::VectorXd::Constant(2, 3.0);
  return problem;
}

TEST(CertificateCoverage, TakesEachWayToDivideASolutionOfDependentRows) {
  const MpQp problem = nearest_in_a_corner();
  const OutputLaw output = test::first_input(problem, 3.0);
  const auto proof = [&](const Sets& corner) {
    Sets sets = {{}, {0}, {1}};
    sets.insert(sets.end(), corner.begin(), corner.end());
    return certify(problem, output, sets);
  };
  for (const Sets& corner : {Sets{{0, 1}}, Sets{{0, 2}, {1, 2}}, Sets{{1, 2}, {0, 2}}}) {
    const LawCertificate good = proof(corner);
    EXPECT_TRUE(good.failure.empty()) << good.failure;
    EXPECT_NEAR(good.coverage.volume, 1.0, 1e-14);
  }
  EXPECT_NE(proof({}).failure.find("is not in the list"), std::string::npos);
  EXPECT_NE(proof({{0, 2}}).failure.find("is not in the list"), std::string::npos);
  for (const Sets& twice : {Sets{{0, 1}, {0, 2}}, Sets{{0, 1}, {0, 2}, {1, 2}}}) {
    EXPECT_NE(proof(twice).failure.find("overlap"), std::string::npos) << proof(twice).failure;
  }
}

// Under a pyramid of four sides: its top belongs to four planes, and to {0, 1, 2} and {0, 2, 3} or
// to {1, 2, 3} and {0, 1, 3}.
TEST(CertificateCoverage, TakesEachWayToDivideTheTopOfAPyramid) {
  MpQp problem;
  problem.H = Eigen::MatrixXd::Identity(3, 3);
  problem.F = -Eigen::MatrixXd::Identity(3, 3);
  problem.f = Eigen::VectorXd::Zero(3);
  problem.G.resize(4, 3);
  problem.G << 1.0, 0.0, 1.0, 0.0, 1.0, 1.0, -1.0, 0.0, 1.0, 0.0, -1.0, 1.0;
  problem.w = Eigen::VectorXd::Ones(4);
  problem.S = Eigen::MatrixXd::Zero(4, 3);
  problem.lower = Eigen::VectorXd::Constant(3, -3.0);
  problem.upper = Eigen::VectorXd::Constant(3, 4.0);
  const OutputLaw output = test::first_input(problem, 3.0);
  const auto proof = [&](const Sets& top) {
    Sets sets = {{}, {0}, {1}, {2}, {3}, {0, 1}, {1, 2}, {2, 3}, {0, 3}};
    sets.insert(sets.end(), top.begin(), top.end());
    return certify(problem, output, sets);
  };
  for (const Sets& top : {Sets{{0, 1, 2}, {0, 2, 3}}, Sets{{1, 2, 3}, {0, 1, 3}}}) {
    const LawCertificate good = proof(top);
    EXPECT_TRUE(good.failure.empty()) << good.failure;
    EXPECT_NEAR(good.coverage.volume, 1.0, 1e-12);
    EXPECT_FALSE(proof({top[0]}).covered);
    EXPECT_FALSE(proof({top[1]}).covered);
  }
  EXPECT_FALSE(proof({{0, 1, 2}, {0, 1, 3}}).covered) << "overlap in a quarter, hole in another";
  EXPECT_FALSE(proof({{0, 1, 2}, {0, 2, 3}, {0, 1, 3}}).covered);
}

TEST(CertificateCoverage, IsTheSameForAnyNumberOfThreads) {
  const MpQp problem = test::benchmark_p5(10, 2.0);
  const OutputLaw output = test::first_input(problem, 4.0);
  const Sets sets = active_sets(problem);
  const LawCertificate one = certify(problem, output, sets, true, 1);
  const LawCertificate three = certify(problem, output, sets, true, 3);
  EXPECT_EQ(one.regions.stationarity, three.regions.stationarity);
  EXPECT_EQ(one.regions.lps, three.regions.lps);
  EXPECT_EQ(one.coverage.matched, three.coverage.matched);
  EXPECT_EQ(one.coverage.jump, three.coverage.jump);
  EXPECT_EQ(one.coverage.law_mismatch, three.coverage.law_mismatch);
}

TEST(CertificateCoverage, CanBeCancelledAndRefusesNonsense) {
  MpQp problem = test::clipped_sum(2);
  const OutputLaw output = test::only_input(problem);
  LawCertificateOptions options;
  options.progress = [](const char*, int, int) { return false; };
  EXPECT_THROW(certify_law(problem, output, test::clipped_sum_sets(), nullptr, options), Cancelled);
  problem.H(0, 0) = -1.0;
  EXPECT_THROW(certify(problem, output, {{}}), std::invalid_argument);
  problem.H(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(certify(problem, output, {{}}), std::invalid_argument);
}

TEST(PolytopeVolume, IsExactForBoxesSimplicesAndRepeatedRows) {
  EXPECT_DOUBLE_EQ(polytope_volume(HalfSpaces(3)), 8.0);
  HalfSpaces simplex(3);  // x + y + z ≤ −2 in [-1, 1]³: edges of 1
  const double a = 1.0 / std::sqrt(3.0);
  const double normal[] = {a, a, a};
  simplex.append(normal, -2.0 * a);
  EXPECT_NEAR(polytope_volume(simplex), 1.0 / 6.0, 1e-15);
  simplex.append(normal, -2.0 * a);
  EXPECT_NEAR(polytope_volume(simplex), 1.0 / 6.0, 1e-15);
  HalfSpaces half(2);
  const double up[] = {0.0, 1.0};
  half.append(up, 0.25);
  EXPECT_DOUBLE_EQ(polytope_volume(half), 2.5);
}

}  // namespace
}  // namespace eampc::law_design
