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

TEST(LawPacking, ALatticeHoldsAsManyPiecesAsItsIndexCanName) {
  LawTables tables = one_piece_law({1.0, 2.0}, 0.0);
  constexpr int kMost = control::PackedLeaf::kMostPieces;
  tables.piece_gain.assign(2 * (kMost + 1), 0.0);
  tables.piece_offset.assign(kMost + 1, 1.0);
  tables.piece_offset[kMost - 1] = 0.5;
  tables.piece_offset[kMost] = 0.25;
  tables.term_pieces.clear();
  for (int piece = 0; piece < kMost; ++piece) tables.term_pieces.push_back(piece);
  tables.term_pieces.insert(tables.term_pieces.end(), {kMost - 1, 0});
  tables.term_first = {0, kMost, kMost + 2};
  tables.leaf_first = {0, 2};
  const double p[] = {0.0, 0.0};
  for (const char* path : {"best", "scalar", "vector128"}) {
    const LawPacking most(tables, evaluation_path(path));
    EXPECT_EQ(control::evaluate(most.law(), p).u, 0.5);
    EXPECT_EQ(control::evaluate(most.law(), p).piece, kMost - 1);
  }
  tables.term_pieces.back() = kMost;
  const auto defect = find_defect(tables);
  ASSERT_TRUE(defect.has_value());
  EXPECT_EQ(defect->key, "evaluator.term_pieces");
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
  // Nine pieces in one term are two rows. Nine terms of 3, 1, … pieces, all the same one, are eight
  // lines of 16 and 3 + 1 comparisons in eight lanes; nine terms of 50 are more one by one.
  t.term_pieces.assign(9, 0);
  t.term_first = {0, 9};
  EXPECT_EQ(evaluation_cost(t), 16 * 5);
  t.term_pieces.assign(11, 0);
  t.term_first = {0, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  t.leaf_first = {0, 9};
  EXPECT_EQ(evaluation_cost(t), 8 * 16 + (3 + 1) * 8);
  LawTables longer = t;
  longer.term_pieces.assign(9 * 50, 0);
  longer.term_first.clear();
  for (int k = 0; k <= 9; ++k) longer.term_first.push_back(50 * k);
  EXPECT_EQ(evaluation_cost(longer), 9 * 50 * 5);
  // A node of 8·4 + 1 above a leaf of one piece and that one.
  t.hyperplanes = {1.0, 0.0, 0.0};
  t.node_planes = {0, -1, -1, -1, -1, -1, -1};
  t.node_children = {~1, ~1, ~1, ~1, ~0, ~0, ~0, ~0};
  t.root = 0;
  t.depth = 1;
  t.term_pieces.push_back(0);
  t.term_first.push_back(12);
  t.leaf_first.push_back(10);
  EXPECT_EQ(evaluation_cost(t), 33 + 160);
  // Flat: one hyperplane is eight, two leaves are eight of 2.
  t.flat = true;
  t.root = -1;
  t.depth = 0;
  t.node_planes.clear();
  t.node_children.clear();
  t.leaf_care = {1, 0};
  t.leaf_bits = {1, 0};
  EXPECT_EQ(evaluation_cost(t), 32 + 16 + 160);
}

}  // namespace
}  // namespace eampc::service
