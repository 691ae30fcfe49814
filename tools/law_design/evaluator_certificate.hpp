// The evaluator gives the law everywhere: |clip(evaluator) − clip(law)| ≤ tolerance.
//
// Each region R is pushed down the evaluator. Linear programs decide on which sides of a
// hyperplane R ∩ cell lies, so R reaches every leaf it has points in. There the leaf's
// max_t min_{k∈t} y_k is compared with R's law y by showing that no point of P = R ∩ cell is in
// error by more than ε (outputs scaled to 0 … 1):
//   too high  for a term t:  y_k ≥ y + ε, y_k ≥ ε for all k ∈ t, y ≤ 1 − ε    has no point in P
//   too low   y ≥ ε, and from every term one k with y_k ≤ y − ε, y_k ≤ 1 − ε   has no point in P
// Both are linear in q (the second after a choice of pieces, tried one by one), so every question
// is a linear program, and none is sampled.
//
// What doubles leave open is asked again in extended precision, with every condition of the region:
// in a corner between nearly parallel planes, rounding reaches far.
//
// A region that reaches less than kSide beyond a hyperplane counts as on one side of it, and
// rounding may send a point that near a hyperplane either way: there the value is of the
// neighbouring cell, wrong by no more than kSide times both slopes (`edge_error`).
#pragma once

#include <string>
#include <vector>

#include "law_design/certificate_problem.hpp"
#include "law_design/law_in_tables.hpp"
#include "law_design/parallel_range.hpp"
#include "law_design/region_certificate.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design {

struct EvaluatorOptions {
  double tolerance = 1e-9;  ///< of the output's range
  int threads = 1;
  bool programs_only = false;  ///< without quick_leaf_proof.hpp
};

struct EvaluatorCertificate {
  bool proved = false;
  std::string failure;      ///< one sentence; empty if proved
  double law_error = 0.0;   ///< proved bound but for slivers, tolerance times a power of ten
  double edge_error = 0.0;  ///< added within kSide of a hyperplane
  long cells = 0;           ///< pairs of a region and a leaf it reaches
  long wrong_cells = 0;     ///< of these, in error by more than the tolerance
  /// Cells in error by more than the tolerance only at points that hold no ball of radius 1e-9,
  /// mostly where the list of regions leaves out flat ones: how many, bound, and largest ball.
  long slivers = 0;
  double sliver_error = 0.0, sliver_radius = 0.0;
  long decided_again = 0;  ///< questions that doubles left open, decided in extended precision
  long lps = 0;
};

/// `regions` and `gaps` together are all there is (see coverage_certificate.hpp).
EvaluatorCertificate certify_evaluator(const CertificateProblem& problem, const OutputLaw& output,
                                       const service::LawTables& tables,
                                       const std::vector<CertifiedRegion>& regions,
                                       const std::vector<CertifiedRegion>& gaps,
                                       const EvaluatorOptions& options,
                                       const LoopProgress& progress = {});

}  // namespace eampc::law_design
