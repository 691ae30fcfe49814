// Every path of the evaluation against the rules of the law file, written here as plain loops over
// the tables: equal to the bit, on random laws and on points that lie on their hyperplanes.
#include "control/point_location.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "service/law_packing.hpp"

namespace eampc::control {
namespace {

using service::LawPacking;
using service::LawTables;

// Adjacent pairs, level by level, an odd one carried.
double pairwise(std::vector<double> terms) {
  while (terms.size() > 1) {
    std::vector<double> sums;
    for (std::size_t i = 0; i + 1 < terms.size(); i += 2) sums.push_back(terms[i] + terms[i + 1]);
    if (terms.size() % 2 == 1) sums.push_back(terms.back());
    terms = sums;
  }
  return terms.front();
}

class NaiveLaw {
 public:
  explicit NaiveLaw(const LawTables& tables)
      : t_(tables), np_(static_cast<std::size_t>(tables.n_parameters)) {}

  double value(std::vector<double> p) const {
    const bool turned = turn(p);
    const int leaf = t_.flat ? flat_leaf(p) : tree_leaf(p);
    if (leaf < 0) return std::numeric_limits<double>::quiet_NaN();
    double largest = -std::numeric_limits<double>::infinity();
    for (int term = t_.leaf_first[at(leaf)]; term < t_.leaf_first[at(leaf) + 1]; ++term) {
      double smallest = std::numeric_limits<double>::infinity();
      for (int i = t_.term_first[at(term)]; i < t_.term_first[at(term) + 1]; ++i) {
        const double v = piece(t_.term_pieces[at(i)], p);
        if (std::isnan(v)) return v;
        smallest = v < smallest ? v : smallest;
      }
      largest = smallest > largest ? smallest : largest;
    }
    return turned ? -largest : largest;
  }

  // −p where fold·p < 0.
  bool turn(std::vector<double>& p) const {
    std::vector<double> folded;
    for (std::size_t j = 0; j < np_; ++j) folded.push_back(t_.fold[j] * p[j]);
    const bool turned = pairwise(folded) < 0.0;
    for (double& x : p) x = turned ? -x : x;
    return turned;
  }

  double piece(int k, const std::vector<double>& p) const {
    std::vector<double> terms = {t_.piece_offset[at(k)]};
    for (std::size_t j = 0; j < np_; ++j) terms.push_back(t_.piece_gain[at(k) * np_ + j] * p[j]);
    return pairwise(terms);
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  bool above(int plane, const std::vector<double>& p) const {
    const double* row = &t_.hyperplanes[at(plane) * (np_ + 1)];
    std::vector<double> terms;
    for (std::size_t j = 0; j < np_; ++j) terms.push_back(row[j] * p[j]);
    return !(pairwise(terms) <= row[np_]);
  }

  int tree_leaf(const std::vector<double>& p) const {
    std::int32_t code = t_.root;
    while (code >= 0) {
      std::size_t place = 0;
      std::size_t path = 0;
      for (int level = 0; level < 3; ++level) {
        const std::int32_t plane = t_.node_planes[at(code) * 7 + place];
        const std::size_t bit = plane >= 0 && above(plane, p) ? 1 : 0;
        place = 2 * place + 1 + bit;
        path = 2 * path + bit;
      }
      code = t_.node_children[at(code) * 8 + path];
    }
    return ~code;
  }

  int flat_leaf(const std::vector<double>& p) const {
    std::uint64_t mask = 0;
    for (std::size_t i = 0; i < t_.n_planes(); ++i) {
      mask |= std::uint64_t{above(static_cast<int>(i), p)} << i;
    }
    for (std::size_t k = 0; k < t_.n_leaves(); ++k) {
      if ((mask & t_.leaf_care[k]) == t_.leaf_bits[k]) return static_cast<int>(k);
    }
    return -1;
  }

  const LawTables& t_;
  std::size_t np_;
};

class RandomLaw {
 public:
  explicit RandomLaw(unsigned seed) : random_(seed) {}

  LawTables tables(int np, bool flat, bool general) {
    LawTables t;
    t.n_parameters = np;
    t.flat = flat;
    t.fold.assign(np_of(t), 0.0);
    if (below(2) == 0) {
      for (double& f : t.fold) f = number();
    }
    const int pieces = 20 + below(40);
    for (int i = 0; i < pieces; ++i) {
      for (int j = 0; j < np; ++j) t.piece_gain.push_back(number());
      t.piece_offset.push_back(number());
    }
    add_leaves(t, 3 + below(flat ? 90 : 20), pieces, general);
    if (flat) {
      add_planes(t, 1 + below(64));
      add_matches(t);
      return t;
    }
    add_planes(t, 40);
    t.root = subtree(t, 3);
    t.depth = t.root < 0 ? 0 : heights_[static_cast<std::size_t>(t.root)];
    return t;
  }

  int below(int n) { return std::uniform_int_distribution<int>(0, n - 1)(random_); }
  // A third of small whole numbers, so that sums are exact and points lie on hyperplanes.
  double number() {
    if (below(3) == 0) return below(5) - 2;
    return std::uniform_real_distribution<double>(-1.0, 1.0)(random_);
  }

 private:
  static std::size_t np_of(const LawTables& t) { return static_cast<std::size_t>(t.n_parameters); }

  void add_leaves(LawTables& t, int count, int pieces, bool general) {
    t.leaf_first = {0};
    t.term_first = {0};
    for (int k = 0; k < count; ++k) {
      const int terms = below(2) == 0 ? 1 : 1 + below(general ? 40 : 20);
      const int longest = general ? 5 : terms == 1 ? 20 : 1;
      for (int i = 0; i < terms; ++i) {
        for (int j = 1 + below(longest); j > 0; --j) t.term_pieces.push_back(below(pieces));
        t.term_first.push_back(static_cast<std::int32_t>(t.term_pieces.size()));
      }
      t.leaf_first.push_back(static_cast<std::int32_t>(t.term_first.size()) - 1);
    }
  }

  void add_planes(LawTables& t, int count) {
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j <= t.n_parameters; ++j) t.hyperplanes.push_back(number());
    }
  }

  void add_matches(LawTables& t) {
    for (std::size_t k = 0; k < t.n_leaves(); ++k) {
      std::uint64_t care = 0;
      for (int i = 0; i < 4; ++i) care |= std::uint64_t{1} << below(static_cast<int>(t.n_planes()));
      t.leaf_care.push_back(care);
      t.leaf_bits.push_back(random_() & care);
    }
  }

  std::int32_t subtree(LawTables& t, int levels) {
    if (levels == 0 || below(5) == 0) return ~below(static_cast<int>(t.n_leaves()));
    const std::size_t node = t.n_nodes();
    for (int k = 0; k < 7; ++k) {
      t.node_planes.push_back(below(8) == 0 ? -1 : below(static_cast<int>(t.n_planes())));
    }
    t.node_children.resize(t.node_children.size() + 8);
    heights_.push_back(0);
    for (std::size_t k = 0; k < 8; ++k) {
      const std::int32_t child = subtree(t, levels - 1);
      t.node_children[8 * node + k] = child;
      const int height = child < 0 ? 0 : heights_[static_cast<std::size_t>(child)];
      heights_[node] = std::max(heights_[node], 1 + height);
    }
    return static_cast<std::int32_t>(node);
  }

  std::mt19937_64 random_;
  std::vector<int> heights_;
};

std::vector<LawPacking> every_path(const LawTables& tables) {
  std::vector<LawPacking> paths;
  for (const EvaluationPath path :
       {EvaluationPath::kBest, EvaluationPath::kScalar, EvaluationPath::kVector128,
        EvaluationPath::kAvx2, EvaluationPath::kAvx512}) {
    if (evaluation(tables.n_parameters, {}, path) != nullptr) paths.emplace_back(tables, path);
  }
  return paths;
}

void expect_equal_to_the_bit(const LawTables& tables, RandomLaw& random, int count) {
  const NaiveLaw naive(tables);
  const std::vector<LawPacking> paths = every_path(tables);
  ASSERT_GE(paths.size(), 2u);
  for (int i = 0; i < count; ++i) {
    std::vector<double> p;
    for (int j = 0; j < tables.n_parameters; ++j) p.push_back(random.number());
    const double expected = naive.value(p);
    const std::int32_t first_piece = evaluate(paths.front().law(), p.data()).piece;
    for (const LawPacking& path : paths) {
      const LawValue found = evaluate(path.law(), p.data());
      ASSERT_EQ(found.piece, first_piece);
      if (std::isnan(expected)) {
        ASSERT_TRUE(std::isnan(found.u));
        ASSERT_EQ(found.piece, -1);
        continue;
      }
      // 0 and −0 are both right where two pieces meet.
      ASSERT_EQ(found.u, expected);
      ASSERT_EQ(std::bit_cast<std::uint64_t>(found.u + 0.0),
                std::bit_cast<std::uint64_t>(expected + 0.0));
      ASSERT_GE(found.piece, 0);
      std::vector<double> turned = p;
      const double sign = naive.turn(turned) ? -1.0 : 1.0;
      ASSERT_EQ(sign * naive.piece(found.piece, turned), expected);
    }
  }
}

class PointLocation : public testing::TestWithParam<int> {};

TEST_P(PointLocation, TreesOfSimpleLeaves) {
  RandomLaw random(static_cast<unsigned>(GetParam()));
  for (int round = 0; round < 30; ++round) {
    expect_equal_to_the_bit(
        RandomLaw(static_cast<unsigned>(round)).tables(GetParam(), false, false), random, 200);
  }
}

TEST_P(PointLocation, TreesAndLatticesOfSeveralPiecesPerTerm) {
  RandomLaw random(static_cast<unsigned>(GetParam()));
  for (int round = 0; round < 30; ++round) {
    LawTables tables = RandomLaw(static_cast<unsigned>(round)).tables(GetParam(), false, true);
    expect_equal_to_the_bit(tables, random, 100);
    tables.root = ~0;
    tables.depth = 0;
    expect_equal_to_the_bit(tables, random, 100);
  }
}

TEST_P(PointLocation, FlatEvaluatorsWithHoles) {
  RandomLaw random(static_cast<unsigned>(GetParam()));
  for (int round = 0; round < 30; ++round) {
    for (const bool general : {false, true}) {
      const auto seed = static_cast<unsigned>(round);
      expect_equal_to_the_bit(RandomLaw(seed).tables(GetParam(), true, general), random, 100);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Parameters, PointLocation, testing::Range(1, kMaxParameters + 1));

TEST(PointLocationFold, TurnsTheOtherHalfOfTheBox) {
  RandomLaw random(5);
  LawTables tables = RandomLaw(9).tables(5, false, false);
  tables.fold = {0.5, -1.0, 0.0, 2.0, 0.25};
  expect_equal_to_the_bit(tables, random, 2000);
  const LawPacking packing(tables);
  const double p[] = {0.3, -0.2, 0.9, 0.7, 0.1};
  const double minus_p[] = {-0.3, 0.2, -0.9, -0.7, -0.1};
  EXPECT_EQ(evaluate(packing.law(), p).u, -evaluate(packing.law(), minus_p).u);
}

// u = 2 p0 + 1 where p0 + p1 ≤ 1, else −3 p1 where p1 ≤ 0.5, else the larger of 7 and 9 p0.
LawTables hand_made() {
  LawTables t;
  t.n_parameters = 2;
  t.hyperplanes = {1.0, 1.0, 1.0, 0.0, 1.0, 0.5};
  t.root = 0;
  t.depth = 1;
  t.node_planes = {0, -1, 1, -1, -1, -1, -1};
  t.node_children = {~0, ~0, ~0, ~0, ~1, ~1, ~2, ~2};
  t.piece_gain = {2.0, 0.0, 0.0, -3.0, 0.0, 0.0, 9.0, 0.0};
  t.piece_offset = {1.0, 0.0, 7.0, 0.0};
  t.leaf_first = {0, 1, 2, 4};
  t.term_first = {0, 1, 2, 3, 4};
  t.term_pieces = {0, 1, 2, 3};
  t.fold = {0.0, 0.0};
  return t;
}

TEST(PointLocationByHand, FollowsSidesAndTakesTheLarger) {
  for (const LawPacking& path : every_path(hand_made())) {
    const auto at = [&](double x, double y) {
      const double p[] = {x, y};
      return evaluate(path.law(), p);
    };
    EXPECT_EQ(at(0.25, 0.5).u, 1.5);
    EXPECT_EQ(at(0.5, 0.5).piece, 0);  // on the hyperplane: below
    EXPECT_EQ(at(2.0, 0.25).u, -0.75);
    EXPECT_EQ(at(0.5, 0.75).u, 7.0);
    EXPECT_EQ(at(0.5, 0.75).piece, 2);
    EXPECT_EQ(at(2.0, 0.75).u, 18.0);
    EXPECT_EQ(at(2.0, 0.75).piece, 3);
    const LawValue none = at(std::numeric_limits<double>::quiet_NaN(), 0.0);
    EXPECT_TRUE(std::isnan(none.u));
    EXPECT_EQ(none.piece, -1);
  }
}

TEST(PointLocationByHand, AFlatEvaluatorWithoutAMatchHasNoValue) {
  LawTables t = hand_made();
  t.flat = true;
  t.root = -1;
  t.depth = 0;
  t.node_planes.clear();
  t.node_children.clear();
  t.leaf_care = {1, 3, 3};
  t.leaf_bits = {0, 1, 2};
  for (const LawPacking& path : every_path(t)) {
    const double below[] = {0.0, 0.75};
    EXPECT_EQ(evaluate(path.law(), below).piece, 0);  // the first that matches
    const double middle[] = {2.0, 0.25};
    EXPECT_EQ(evaluate(path.law(), middle).piece, 1);
    const double none[] = {2.0, 0.75};
    EXPECT_TRUE(std::isnan(evaluate(path.law(), none).u));
    EXPECT_EQ(evaluate(path.law(), none).piece, -1);
  }
}

TEST(PointLocationByHand, NoPathForMoreParametersThanFit) {
  EXPECT_EQ(evaluation(0, {}, EvaluationPath::kScalar), nullptr);
  EXPECT_EQ(evaluation(kMaxParameters + 1, {}, EvaluationPath::kBest), nullptr);
}

}  // namespace
}  // namespace eampc::control
