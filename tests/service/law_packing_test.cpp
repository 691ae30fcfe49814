#include "service/law_packing.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <stdexcept>
#include <utility>

#include "one_piece_law.hpp"
#include "service/law_cost.hpp"

namespace eampc::service {
namespace {

TEST(LawPacking, LeavesOfTheSamePiecesShareTheirRows) {
  LawTables one = one_piece_law({1.0, 2.0}, 3.0);
  one.leaf_first = {0, 1, 2, 3};
  one.term_first = {0, 1, 2, 3};
  one.term_pieces = {0, 0, 0};
  const LawPacking shared(one);
  EXPECT_EQ(shared.law().rows.size(), 3 * control::kLanes);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(shared.law().rows.data()) % 64, 0u);
}

TEST(LawPacking, MovingKeepsWhatTheLawPointsInto) {
  LawPacking first(one_piece_law({1.0, 2.0}, 3.0));
  const control::PackedLaw law = first.law();
  const LawPacking second = std::move(first);
  const double p[] = {10.0, 100.0};
  EXPECT_EQ(control::evaluate(law, p).u, 213.0);
  EXPECT_EQ(control::evaluate(second.law(), p).u, 213.0);
}

TEST(LawPacking, RefusesTablesWithADefectAndPathsThatAreNot) {
  LawTables tables = one_piece_law({1.0, 2.0}, 3.0);
  tables.term_pieces = {1};
  EXPECT_THROW(LawPacking{tables}, std::invalid_argument);
  EXPECT_THROW(evaluation_path("fastest"), std::invalid_argument);
  EXPECT_EQ(evaluation_path("scalar"), control::EvaluationPath::kScalar);
}

// By the header's table: np = 2, so a hyperplane is 4 operations and a piece 5, always eight at
// once.
TEST(EvaluationCost, CountedByHand) {
  LawTables t = one_piece_law({1.0, 2.0}, 3.0);
  EXPECT_EQ(evaluation_cost(t), 8 * 5);
  t.fold = {1.0, 0.0};
  EXPECT_EQ(evaluation_cost(t), 8 * 5 + 7);
  t.fold = {0.0, 0.0};
  // Nine pieces in one term are two rows; nine terms of 3, 1, … pieces are 3 + 1 rows.
  t.term_pieces.assign(9, 0);
  t.term_first = {0, 9};
  EXPECT_EQ(evaluation_cost(t), 16 * 5);
  t.term_pieces.assign(11, 0);
  t.term_first = {0, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  t.leaf_first = {0, 9};
  EXPECT_EQ(evaluation_cost(t), 4 * 8 * 5);
  // A node of 8·4 + 1 above a leaf of one piece and that one.
  t.hyperplanes = {1.0, 0.0, 0.0};
  t.node_planes = {0, -1, -1, -1, -1, -1, -1};
  t.node_children = {~1, ~1, ~1, ~1, ~0, ~0, ~0, ~0};
  t.root = 0;
  t.depth = 1;
  t.term_pieces.push_back(0);
  t.term_first.push_back(12);
  t.leaf_first.push_back(10);
  EXPECT_EQ(evaluation_cost(t), 33 + 4 * 8 * 5);
  // Flat: one hyperplane is eight, two leaves are eight of 2.
  t.flat = true;
  t.root = -1;
  t.depth = 0;
  t.node_planes.clear();
  t.node_children.clear();
  t.leaf_care = {1, 0};
  t.leaf_bits = {1, 0};
  EXPECT_EQ(evaluation_cost(t), 32 + 16 + 4 * 8 * 5);
}

}  // namespace
}  // namespace eampc::service
