// Laws that are odd about the centre of their box, y(−p) = −y(p): half of the parameters is enough
// for their evaluator, on one side of a hyperplane through the centre (the fold).
#pragma once

#include <optional>

#include "law_design/law_partition.hpp"

namespace eampc::law_design {

/// The normal, scaled, of a fold that cuts few regions. Nothing unless the box and the output's
/// range are symmetric about 0 and every region has a counterpart that is its mirror image: facets
/// to 1e-9, law to 2e-9 of the output's range. One region in a hundred may lack it, where ties
/// between active sets are broken differently, if the law is odd at its centre.
std::optional<Hyperplane> odd_symmetry(const LawPartition& partition);

/// Removes what lies below the fold; regions that it cuts end there. Mirror images that are missing
/// are added: what holds of the half then holds of the whole.
LawPartition half_above(const LawPartition& partition, const Hyperplane& fold);

/// The fold in the problem's own parameters: a unit vector.
Eigen::VectorXd fold_in_problem_units(const Hyperplane& fold, const LawPartition& partition);

}  // namespace eampc::law_design
