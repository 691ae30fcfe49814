// A law's tables in the certificate's scale: hyperplanes over q with unit normals, pieces as forms
// with u_min at 0 and u_max at 1. Read from the tables alone.
#pragma once

#include <vector>

#include "law_design/certificate_problem.hpp"
#include "law_design/extended_program.hpp"
#include "law_design/half_spaces.hpp"
#include "law_design/region_certificate.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design {

struct LawInTables {
  HalfSpaces planes{0};
  std::vector<ExtendedForm> extended_planes;  ///< form·(q, 1) ≥ 0 is above
  std::vector<AffineForm> pieces;
  std::vector<ExtendedForm> extended_pieces;
  bool folded = false;
  AffineForm fold{};            ///< unit, without constant
  double steepest_piece = 0.0;  ///< largest |gain| of a piece
};

/// Throws std::invalid_argument if the tables do not fit the problem, name what does not exist, or
/// fold a law whose box or range is not symmetric about 0.
LawInTables law_in_tables(const service::LawTables& tables, const CertificateProblem& problem,
                          const OutputLaw& output);

/// Most nodes on a path from the root, counted anew. Throws if a path runs in a circle.
int tree_depth(const service::LawTables& tables);

}  // namespace eampc::law_design
