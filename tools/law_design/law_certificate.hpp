// The proofs of an explicit law from what its file holds, in one run: optimality of every region,
// coverage and continuity, and the evaluator against all of it. See the headers of the parts.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "law_design/coverage_certificate.hpp"
#include "law_design/evaluator_certificate.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/region_certificate.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design {

/// Limits that a proof must keep. Relative: of the size of the terms, or of the output's range.
struct CertificateLimits {
  double residual = 1e-12;  ///< of the optimality conditions
  double mismatch = 1e-7;   ///< of planes and laws that meet
  double jump = 1e-9;       ///< of the output across facets
  double law_error = 1e-9;  ///< of the evaluator
};

struct LawCertificateOptions {
  CertificateLimits limits;
  bool infeasible_allowed = false;
  int threads = 0;             ///< 0: as many as the machine runs at once
  bool programs_only = false;  ///< see EvaluatorOptions
  /// Called with (part, done, of all); false cancels.
  std::function<bool(const char*, int, int)> progress;
};

struct LawCertificate {
  bool optimal = false, covered = false, continuous = false, evaluated = false;
  std::string failure;  ///< the first thing that could not be proved, one sentence; else empty
  double smallest_eigenvalue = 0.0, largest_eigenvalue = 0.0;
  RegionsCertificate regions;
  CoverageCertificate coverage;
  std::optional<EvaluatorCertificate> evaluator;  ///< if there were tables
  int depth = 0;                                  ///< of the tree, counted anew
  double seconds = 0.0;
};

/// Throws std::invalid_argument for data that make no sense, Cancelled.
LawCertificate certify_law(const MpQp& problem, const OutputLaw& output,
                           const std::vector<std::vector<int>>& active_sets,
                           const service::LawTables* tables, const LawCertificateOptions& options);

}  // namespace eampc::law_design
