#include <gtest/gtest.h>

#include "law_design/certificate_test_problems.hpp"
#include "law_design/law_certificate.hpp"
#include "law_design/mpqp_test_problems.hpp"

namespace eampc::law_design {
namespace {

LawCertificate certify(const MpQp& problem, const service::LawTables& tables) {
  LawCertificateOptions options;
  options.threads = 2;
  return certify_law(problem, test::only_input(problem), test::clipped_sum_sets(), &tables,
                     options);
}

// clip(−Σp) as one piece, as a lattice with clipped and superfluous terms, and wrong ones.
TEST(CertificateEvaluator, ProvesLatticesAndFindsWrongOnes) {
  const MpQp problem = test::clipped_sum(2);
  const std::vector<std::pair<double, double>> pieces = {
      {-1.0, 0.0}, {0.0, 1.0}, {0.0, -1.0}, {-1.0, 1e-6}, {-2.0, 0.0}};
  const auto proved = [&](const std::vector<std::vector<int>>& terms) {
    return certify(problem, test::lattice(2, pieces, terms)).evaluated;
  };
  EXPECT_TRUE(proved({{0}}));
  EXPECT_TRUE(proved({{0, 1}}));        // min(law, 1)
  EXPECT_TRUE(proved({{0}, {2}}));      // max(law, −1)
  EXPECT_TRUE(proved({{0, 1}, {2}}));   // both
  EXPECT_TRUE(proved({{0, 3}, {2}}));   // the larger neighbour is never taken
  EXPECT_FALSE(proved({{3}}));          // 1e-6 off
  EXPECT_FALSE(proved({{0}, {3}}));     // the larger one is taken
  EXPECT_FALSE(proved({{1}}));          // saturated everywhere
  EXPECT_FALSE(proved({{0, 2}}));       // min(law, −1)
  EXPECT_FALSE(proved({{4}}));          // twice the slope
  EXPECT_FALSE(proved({{0, 4}, {2}}));  // wrong where Σp > 0
}

// The plane Σp = s between two leaves.
service::LawTables two_leaves(double s, const std::vector<std::pair<double, double>>& pieces) {
  service::LawTables tables = test::lattice(2, pieces, {{0}, {1}});
  const double a = 1.0 / std::sqrt(2.0);
  tables.hyperplanes = {a, a, s * a};
  tables.leaf_first = {0, 1, 2};
  tables.root = 0;
  tables.depth = 1;
  tables.node_planes = {0, -1, -1, -1, -1, -1, -1};
  tables.node_children = {~0, ~0, ~0, ~0, ~1, ~1, ~1, ~1};
  return tables;
}

TEST(CertificateEvaluator, ProvesATreeAndFindsWrongChildrenPlanesAndDepth) {
  const MpQp problem = test::clipped_sum(2);
  // Below Σp = −1 the upper bound, above it the law: right; any plane further up is wrong.
  const std::vector<std::pair<double, double>> pieces = {{0.0, 1.0}, {-1.0, 0.0}};
  const service::LawTables right = two_leaves(-1.0, pieces);
  const LawCertificate proof = certify(problem, right);
  EXPECT_TRUE(proof.evaluated) << proof.failure;
  EXPECT_LE(proof.evaluator->law_error, 1e-9);
  EXPECT_EQ(proof.depth, 1);

  EXPECT_FALSE(certify(problem, two_leaves(-0.9, pieces)).evaluated);
  EXPECT_TRUE(certify(problem, two_leaves(-1.2, pieces)).evaluated) << "clipping covers it";
  service::LawTables wrong = right;
  std::swap(wrong.node_children[0], wrong.node_children[4]);
  EXPECT_FALSE(certify(problem, wrong).evaluated);
  wrong = right;
  for (double& x : wrong.hyperplanes) x = -x;  // the wrong sign of the plane
  EXPECT_FALSE(certify(problem, wrong).evaluated);
  wrong = right;
  std::swap(wrong.piece_gain[0], wrong.piece_gain[2]);
  EXPECT_FALSE(certify(problem, wrong).evaluated);
  wrong = right;
  wrong.depth = 2;
  EXPECT_FALSE(certify(problem, wrong).evaluated);
  wrong = right;
  wrong.node_children[3] = 0;  // a circle
  EXPECT_THROW(certify(problem, wrong), std::invalid_argument);
  wrong = right;
  wrong.node_children[3] = ~5;
  EXPECT_THROW(certify(problem, wrong), std::invalid_argument);
}

TEST(CertificateEvaluator, FollowsAFlatMaskInTheOrderOfItsLeaves) {
  const MpQp problem = test::clipped_sum(2);
  service::LawTables tables = two_leaves(-1.0, {{0.0, 1.0}, {-1.0, 0.0}});
  tables.flat = true;
  tables.depth = 0;
  tables.root = -1;
  tables.node_planes.clear();
  tables.node_children.clear();
  tables.leaf_care = {1, 0};
  tables.leaf_bits = {0, 0};
  EXPECT_TRUE(certify(problem, tables).evaluated);
  std::swap(tables.leaf_care[0], tables.leaf_care[1]);  // the first leaf now matches everything
  EXPECT_FALSE(certify(problem, tables).evaluated);
  tables.leaf_care = {1, 1};
  tables.leaf_bits = {0, 0};  // nothing matches above
  EXPECT_FALSE(certify(problem, tables).evaluated);
}

TEST(CertificateEvaluator, ChecksBothHalvesOfAFoldedLaw) {
  const MpQp problem = test::clipped_sum(2);
  service::LawTables tables = test::lattice(2, {{-1.0, 0.0}, {0.0, -1.0}}, {{0}, {1}});
  tables.fold = {1.0, 0.0};
  EXPECT_TRUE(certify(problem, tables).evaluated);
  tables.piece_offset[0] = 0.25;  // no longer odd
  EXPECT_FALSE(certify(problem, tables).evaluated);
  MpQp lopsided = problem;
  lopsided.upper(0) = 1.5;
  tables.piece_offset[0] = 0.0;
  EXPECT_THROW(certify(lopsided, tables), std::invalid_argument);
}

// With u0 = 0 and N = 3 the whole law is its unconstrained piece, clipped: the case in which a law
// that is clipped without proof is wrong by the full range.
TEST(CertificateEvaluator, ProvesThatOnePieceClippedIsABenchmarksLaw) {
  const MpQp problem = test::benchmark_p5(3, 0.0);
  const OutputLaw output = test::first_input(problem, 4.0);
  std::vector<std::vector<int>> sets;
  service::LawTables tables = test::lattice(5, {{0.0, 0.0}}, {{0}});
  for (const CriticalRegion& region : solve_mpqp(problem).regions) {
    sets.push_back(region.active_set);
    if (!region.active_set.empty()) continue;
    for (int j = 0; j < 5; ++j) tables.piece_gain[static_cast<std::size_t>(j)] = region.gain(0, j);
    tables.piece_offset[0] = region.offset(0);
  }
  LawCertificateOptions options;
  options.threads = 2;
  options.infeasible_allowed = true;
  const LawCertificate proof = certify_law(problem, output, sets, &tables, options);
  EXPECT_TRUE(proof.evaluated) << proof.failure;
  EXPECT_EQ(proof.evaluator->cells, 15);
  std::swap(tables.piece_gain[0], tables.piece_gain[1]);
  EXPECT_FALSE(certify_law(problem, output, sets, &tables, options).evaluated);
}

}  // namespace
}  // namespace eampc::law_design
