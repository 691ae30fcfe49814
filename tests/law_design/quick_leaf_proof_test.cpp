#include "law_design/quick_leaf_proof.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "law_design/law_certificate.hpp"
#include "law_design/law_structure.hpp"
#include "law_design/mpqp_test_problems.hpp"

namespace eampc::law_design {
namespace {

using service::LawTables;

// A law of the benchmark and both ways to prove tables against it.
struct Benchmark {
  Benchmark(int horizon, double u0)
      : problem(test::benchmark_p5(horizon, u0)), output(test::first_input(problem, 4.0)) {
    const MpQpSolution solution = solve_mpqp(problem);
    tables = build_law_structure(solution, output).tables;
    for (const CriticalRegion& region : solution.regions) sets.push_back(region.active_set);
  }

  EvaluatorCertificate certify(const LawTables& changed, bool programs_only) const {
    LawCertificateOptions options;
    options.threads = 2;
    options.infeasible_allowed = true;
    options.programs_only = programs_only;
    return *certify_law(problem, output, sets, &changed, options).evaluator;
  }

  /// Both give the same verdict, which is returned.
  bool proved(const LawTables& changed) const {
    const EvaluatorCertificate quick = certify(changed, false);
    const EvaluatorCertificate full = certify(changed, true);
    EXPECT_EQ(quick.proved, full.proved) << quick.failure << full.failure;
    EXPECT_EQ(quick.failure, full.failure);
    EXPECT_EQ(quick.cells, full.cells);
    EXPECT_EQ(quick.wrong_cells, full.wrong_cells);
    EXPECT_EQ(quick.law_error, full.law_error);
    return quick.proved;
  }

  MpQp problem;
  OutputLaw output;
  LawTables tables;
  std::vector<std::vector<int>> sets;
};

TEST(QuickLeafProof, ProvesTheLawsOfTheBenchmarkWithFewerPrograms) {
  for (const double u0 : {0.0, 2.0}) {
    SCOPED_TRACE(u0);
    const Benchmark benchmark(10, u0);
    EXPECT_TRUE(benchmark.proved(benchmark.tables));
    EXPECT_LT(benchmark.certify(benchmark.tables, false).lps,
              benchmark.certify(benchmark.tables, true).lps);
  }
}

TEST(QuickLeafProof, RefusesTheSameTamperedTables) {
  const Benchmark benchmark(10, 2.0);
  const LawTables& right = benchmark.tables;
  ASSERT_GT(right.n_pieces(), 2U);
  int refused = 0;
  const std::size_t step = (right.n_pieces() + 4) / 5;
  for (std::size_t piece = 0; piece < right.n_pieces(); piece += step) {
    SCOPED_TRACE(piece);
    for (const double shift : {-1e-2, 1e-6}) {
      LawTables wrong = right;
      wrong.piece_offset[piece] += shift;
      EXPECT_FALSE(benchmark.proved(wrong));
    }
    LawTables wrong = right;
    wrong.piece_gain[piece * static_cast<std::size_t>(right.n_parameters)] *= 1.001;
    EXPECT_FALSE(benchmark.proved(wrong));
  }
  const std::size_t literals = (right.term_pieces.size() + 9) / 10;
  for (std::size_t at = 0; at < right.term_pieces.size(); at += literals) {
    SCOPED_TRACE(at);
    LawTables wrong = right;
    wrong.term_pieces[at] = static_cast<std::int32_t>(
        (static_cast<std::size_t>(right.term_pieces[at]) + 1) % right.n_pieces());
    refused += benchmark.proved(wrong) ? 0 : 1;
  }
  EXPECT_GT(refused, 0);
}

}  // namespace
}  // namespace eampc::law_design
