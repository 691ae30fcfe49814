#include "law_design/law_certificate.hpp"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>

namespace eampc::law_design {
namespace {

LoopProgress part_of(const LawCertificateOptions& options, const char* part) {
  if (!options.progress) return {};
  return [&options, part](int done, int all) { return options.progress(part, done, all); };
}

std::string with_number(const char* format, double value, double limit) {
  char text[160];
  std::snprintf(text, sizeof text, format, value, limit);
  return text;
}

std::string optimality_failure(const RegionsCertificate& regions, const CertificateLimits& limits) {
  if (regions.regions.empty()) return "the law lists no active set";
  if (regions.empty > 0) {
    return std::to_string(regions.empty) +
           " active sets have no region: their conditions contradict each other; the first is "
           "number " +
           std::to_string(regions.first_empty);
  }
  const double worst = std::max(regions.stationarity, regions.primal);
  if (!(worst <= limits.residual)) {
    return with_number("the optimality conditions miss by %.2g, more than %.2g", worst,
                       limits.residual);
  }
  return "";
}

std::string continuity_failure(const CoverageCertificate& coverage,
                               const CertificateLimits& limits) {
  const double mismatch = std::max(coverage.plane_mismatch, coverage.law_mismatch);
  if (!(mismatch <= limits.mismatch)) {
    return with_number("the laws of neighbours differ on their facet by %.2g, more than %.2g",
                       mismatch, limits.mismatch);
  }
  if (!(coverage.jump <= limits.jump)) {
    return with_number("the output jumps across a facet by %.2g of its range, more than %.2g",
                       coverage.jump, limits.jump);
  }
  return "";
}

}  // namespace

LawCertificate certify_law(const MpQp& given, const OutputLaw& output,
                           const std::vector<std::vector<int>>& active_sets,
                           const service::LawTables* tables, const LawCertificateOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  const int threads = thread_count(options.threads);
  const CertificateProblem problem = certificate_problem(given, output);
  LawCertificate result;
  result.smallest_eigenvalue = problem.smallest_eigenvalue;
  result.largest_eigenvalue = problem.largest_eigenvalue;
  const auto say = [&result](const std::string& failure) {
    if (result.failure.empty()) result.failure = failure;
    return failure.empty();
  };

  result.regions = certify_regions(problem, active_sets, threads, part_of(options, "optimality"));
  result.optimal = say(optimality_failure(result.regions, options.limits));

  CoverageOptions coverage;
  coverage.infeasible_allowed = options.infeasible_allowed;
  coverage.threads = threads;
  result.coverage =
      certify_coverage(problem, result.regions.regions, coverage, part_of(options, "coverage"));
  result.covered = say(result.coverage.failure);
  result.continuous = say(continuity_failure(result.coverage, options.limits));

  if (tables != nullptr) {
    EvaluatorOptions evaluator;
    evaluator.tolerance = options.limits.law_error;
    evaluator.threads = threads;
    evaluator.programs_only = options.programs_only;
    result.evaluator =
        certify_evaluator(problem, output, *tables, result.regions.regions,
                          result.coverage.gap_regions, evaluator, part_of(options, "evaluator"));
    result.evaluated = say(result.evaluator->failure);
    result.depth = tree_depth(*tables);
    if (result.depth != tables->depth) {
      result.evaluated = say("the tree has a path of " + std::to_string(result.depth) +
                             " nodes, but the file says " + std::to_string(tables->depth));
    }
  }
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

}  // namespace eampc::law_design
