// The most operations that one evaluation of a law can take, stated in the law file.
// An operation is one multiplication, addition or comparison of numbers; a logical operation on a
// mask of hyperplanes counts as one. Counted as executed, eight lanes at a time, unused lanes
// included, so that no path (scalar, SIMD, generated C) does more:
//   hyperplane  2 np        np products, np − 1 sums, one comparison
//   piece       2 np + 1    np products, np sums, one comparison within its leaf
//   lattice     a leaf of several terms of several pieces: each piece once, as a line of 8 numbers
//               (np = 8: 9), so 8 products, 7 sums, one comparison with u; then one comparison for
//               each piece of each term, eight terms side by side. Or, if that is more, a piece as
//               above for each piece of each term: generated C goes through them one by one
//   node        8 hyperplanes + 1 for the way out; flat: all hyperplanes + 2 per leaf tried
//   fold        3 np + 1    np products, np − 1 sums, one comparison, np signs, one sign of u; the
//                           sign of a hyperplane's sum, which follows it, is not counted
// In instructions, on the scalar path of x86-64: two per operation and 150 for the call. Measured
// by tests/python/test_instruction_count.py: 0.6 to 1.2 times that; on the AVX2 path 0.3 to 0.6
// times.
#pragma once

#include <cstdint>

#include "service/law_tables.hpp"

namespace eampc::service {

/// Of tables without defect.
std::int64_t evaluation_cost(const LawTables& tables);

/// Of leaf k alone.
std::int64_t leaf_cost(const LawTables& tables, std::size_t leaf);

}  // namespace eampc::service
