// The law u = gain·p + offset, for tests of what stands around a law.
#pragma once

#include <utility>
#include <vector>

#include "service/law_tables.hpp"

namespace eampc::service {

inline LawTables one_piece_law(std::vector<double> gain, double offset) {
  LawTables tables;
  tables.n_parameters = static_cast<int>(gain.size());
  tables.fold.assign(gain.size(), 0.0);
  tables.piece_gain = std::move(gain);
  tables.piece_offset = {offset};
  tables.root = ~0;
  tables.leaf_first = {0, 1};
  tables.term_first = {0, 1};
  tables.term_pieces = {0};
  return tables;
}

}  // namespace eampc::service
