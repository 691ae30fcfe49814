// The hyperplanes on which an explicit law's regions meet, each once.
#pragma once

#include <vector>

#include "law_design/binary_tree.hpp"
#include "law_design/cell_contents.hpp"
#include "law_design/output_laws.hpp"

namespace eampc::law_design {

/// A plane is shared by the regions on both sides of it: one entry whatever its sign.
struct LawPlanes {
  std::vector<Hyperplane> planes;
  std::vector<std::vector<int>> law;    ///< per region: planes beyond which another law holds
  std::vector<std::vector<int>> outer;  ///< per region: planes beyond which no region was seen
};

LawPlanes collect_law_planes(const OutputLaws& laws);

/// The plane over p, unit normal; the children are left 0.
SplitNode in_problem_units(const Hyperplane& plane, const OutputLaws& laws);

}  // namespace eampc::law_design
