#include "law_design/evaluator_certificate.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>

#include "law_design/evaluator_descent.hpp"

namespace eampc::law_design {

EvaluatorCertificate certify_evaluator(const CertificateProblem& problem, const OutputLaw& output,
                                       const service::LawTables& tables,
                                       const std::vector<CertifiedRegion>& regions,
                                       const std::vector<CertifiedRegion>& gaps,
                                       const EvaluatorOptions& options,
                                       const LoopProgress& progress) {
  const LawInTables law = law_in_tables(tables, problem, output);
  std::vector<const CertifiedRegion*> all;
  double steepest = 0.0;
  for (const auto* list : {&regions, &gaps}) {
    for (const CertifiedRegion& region : *list) {
      if (!region.solved) continue;
      all.push_back(&region);
      double slope = 0.0;
      for (int j = 0; j < problem.parameters; ++j) {
        slope += std::pow(region.output[static_cast<std::size_t>(j)], 2);
      }
      if (list == &regions) steepest = std::max(steepest, std::sqrt(slope));
    }
  }
  std::vector<std::unique_ptr<EvaluatorDescent>> descents;
  for (int t = 0; t < options.threads; ++t) {
    descents.push_back(std::make_unique<EvaluatorDescent>(problem, tables, law, options.tolerance,
                                                          !options.programs_only));
  }
  std::vector<EvaluatorDescent::Result> parts(all.size());
  parallel_range(
      static_cast<int>(all.size()), options.threads,
      [&](int r, int thread) {
        const std::size_t at = static_cast<std::size_t>(r);
        parts[at] = descents[static_cast<std::size_t>(thread)]->check(*all[at]);
      },
      progress);
  EvaluatorCertificate result;
  result.edge_error = EvaluatorDescent::kSide * (law.steepest_piece + steepest);
  for (std::size_t r = 0; r < parts.size(); ++r) {
    const EvaluatorDescent::Result& part = parts[r];
    result.cells += part.cells;
    result.wrong_cells += part.wrong_cells;
    result.slivers += part.slivers;
    result.sliver_error = std::max(result.sliver_error, part.sliver_error);
    result.sliver_radius = std::max(result.sliver_radius, part.sliver_radius);
    result.decided_again += part.decided_again;
    result.law_error = std::max(result.law_error, part.error);
    if (part.wrong_cells == 0 || !result.failure.empty()) continue;
    std::string active;
    for (const int row : all[r]->active)
      active += (active.empty() ? "" : ", ") + std::to_string(row);
    result.failure =
        part.unmatched ? "no leaf of the evaluator matches a part of the region of the active set {"
                       : "leaf " + std::to_string(part.wrong_leaf) +
                             " of the evaluator does not give the law of the active set {";
    result.failure += active + "}";
  }
  for (const auto& descent : descents) result.lps += descent->lp_count();
  result.proved = result.failure.empty();
  return result;
}

}  // namespace eampc::law_design
