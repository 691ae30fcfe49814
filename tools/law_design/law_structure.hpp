// Regions → the tables of a law: the evaluator with the least worst case among
//   the global lattice  one leaf, if the whole law is one of few pieces
//   flat                all hyperplanes at once, if they are 64 or fewer
//   tree                nodes of seven hyperplanes
// each over leaves proved to hold the law of their cell (lattice_leaf.hpp), and over half of the
// parameters if the law is odd (law_symmetry.hpp).
#pragma once

#include <functional>
#include <string>

#include "law_design/mpqp.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design {

struct LawStructureOptions {
  int threads = 0;  ///< 0: one per core. The tables do not depend on it.
  /// Called now and then with (nodes made, 0); false cancels.
  std::function<bool(long, long)> progress;
};

struct LawStructure {
  service::LawTables tables;
  int regions = 0;
  int unsaturated_regions = 0;
  int distinct_laws = 0;
  int binary_nodes = 0;
  int binary_depth = 0;
  long lps = 0;
  double seconds = 0.0;
};

/// Throws std::invalid_argument if the output makes no sense, std::runtime_error if a cell cannot
/// be proved, Cancelled.
LawStructure build_law_structure(const MpQpSolution& solution, const OutputLaw& output,
                                 const LawStructureOptions& options = {});

}  // namespace eampc::law_design
