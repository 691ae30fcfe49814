// What the loader refuses in the law's pieces and evaluator; one sentence each, with the key.
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>

#include "service/law_file.hpp"
#include "service/synthetic_law.hpp"

namespace eampc::service {
namespace {

std::string refusal(const std::function<void(Tree&)>& change) {
  Tree payload = synthetic_payload();
  change(payload["law"]);
  try {
    LawFile::from_bytes(law_bytes(payload), "rig.law");
    return "";
  } catch (const LawFileError& error) {
    return error.what();
  }
}

// As refusal, but of a change of the evaluator.
std::string evaluator_refusal(const std::function<void(Tree&)>& change) {
  return refusal([&](Tree& law) { change(law["evaluator"]); });
}

Tree nodes(const std::vector<std::int32_t>& values, int columns) {
  return array({static_cast<int>(values.size()) / columns, columns}, values);
}

// Two hyperplanes, three leaves of one piece: e1 above 0; else e2 above 1; else the rest.
void make_flat(Tree& evaluator) {
  evaluator["kind"] = "flat";
  evaluator["hyperplanes"] = matrix(2, 6, {1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1});
  evaluator["root"] = -1;
  evaluator["depth"] = 0;
  evaluator["node_planes"] = nodes({}, 7);
  evaluator["node_children"] = nodes({}, 8);
  evaluator["leaf_care"] = nodes({1, 0, 2, 0, 0, 0}, 2);
  evaluator["leaf_bits"] = nodes({1, 0, 2, 0, 0, 0}, 2);
  evaluator["leaf_first"] = integers({0, 1, 2, 3});
  evaluator["term_first"] = integers({0, 1, 2, 3});
  evaluator["term_pieces"] = integers({0, 0, 0});
  // Eight planes of 10 operations, eight leaves of 2, eight lanes of one piece of 11.
  evaluator["worst_operations"] = 80 + 16 + 88;
}

TEST(LawTablesSection, AcceptsATreeAFlatEvaluatorAndALattice) {
  EXPECT_EQ(evaluator_refusal([](Tree&) {}), "");
  EXPECT_EQ(evaluator_refusal(make_flat), "");
  EXPECT_EQ(refusal([](Tree& law) {
              law["piece_gain"] = matrix(2, 5, std::vector<double>(10, 1.0));
              law["piece_offset"] = vector({1, 2});
              Tree& e = law["evaluator"];
              e["hyperplanes"] = matrix(0, 6, {});
              e["root"] = -1;
              e["depth"] = 0;
              e["node_planes"] = nodes({}, 7);
              e["node_children"] = nodes({}, 8);
              e["leaf_first"] = integers({0, 2});
              e["term_first"] = integers({0, 2, 3});
              e["term_pieces"] = integers({0, 1, 1});
              e["worst_operations"] = 8 * 16 + 2 * 8;  // eight lines, two comparisons
            }),
            "");
}

TEST(LawTablesSection, TableOfDefects) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  struct Row {
    const char* named;
    std::function<void(Tree&)> damage;  // of the evaluator
  };
  const std::vector<std::int32_t> ends(8, -1);
  const auto with_child = [ends](std::int32_t child) {
    return [ends, child](Tree& e) {
      std::vector<std::int32_t> children = ends;
      children[3] = child;
      e["node_children"] = nodes(children, 8);
    };
  };
  const Row rows[] = {
      {"law.evaluator.kind is", [](Tree& e) { e["kind"] = "forest"; }},
      {"law.evaluator lacks the key depth", [](Tree& e) { e.erase("depth"); }},
      {"law.evaluator.node_children names a node or leaf", with_child(-2)},
      {"law.evaluator.node_children names a node or leaf", with_child(1)},
      {"law.evaluator.node_children names a node or leaf",
       with_child(std::numeric_limits<std::int32_t>::min())},
      {"law.evaluator.node_children runs in a circle", with_child(0)},
      {"law.evaluator.node_children does not have eight",
       [](Tree& e) { e["node_children"] = nodes({}, 8); }},
      {"law.evaluator.node_children has the shape 1x7",
       [](Tree& e) { e["node_children"] = nodes(std::vector<std::int32_t>(7, -1), 7); }},
      {"law.evaluator.node_planes names a hyperplane",
       [](Tree& e) {
         e["node_planes"] = nodes({1, -1, -1, -1, -1, -1, -1}, 7);
       }},
      {"law.evaluator.node_planes names a hyperplane",
       [](Tree& e) {
         e["node_planes"] = nodes({0, -2, -1, -1, -1, -1, -1}, 7);
       }},
      {"law.evaluator.depth is 0, but the longest", [](Tree& e) { e["depth"] = 0; }},
      {"law.evaluator.depth is 2, but the longest", [](Tree& e) { e["depth"] = 2; }},
      {"law.evaluator.depth is -1", [](Tree& e) { e["depth"] = -1; }},
      {"law.evaluator.root names", [](Tree& e) { e["root"] = 1; }},
      {"law.evaluator.root names", [](Tree& e) { e["root"] = -2; }},
      {"law.evaluator.hyperplanes holds a number",
       [nan](Tree& e) {
         e["hyperplanes"] = matrix(1, 6, {1, 0, 0, 0, 0, nan});
       }},
      {"law.evaluator.hyperplanes has the shape",
       [](Tree& e) {
         e["hyperplanes"] = matrix(1, 5, {1, 0, 0, 0, 0});
       }},
      {"law.evaluator.leaf_first does not cut", [](Tree& e) { e["leaf_first"] = integers({0}); }},
      {"law.evaluator.leaf_first does not cut", [](Tree& e) { e["leaf_first"] = integers({}); }},
      {"law.evaluator.leaf_first does not cut",
       [](Tree& e) {
         e["leaf_first"] = integers({0, 2});
       }},
      {"law.evaluator.leaf_first does not cut",
       [](Tree& e) {
         e["leaf_first"] = integers({0, 0, 1});
       }},
      {"law.evaluator.term_first does not cut",
       [](Tree& e) {
         e["term_first"] = integers({0, 3});
       }},
      {"law.evaluator.term_first does not cut",
       [](Tree& e) {
         e["term_first"] = integers({0, 2, 1});
       }},
      {"law.evaluator.term_first does not cut",
       [](Tree& e) {
         e["term_first"] = integers({-1, 1});
       }},
      {"law.evaluator.term_pieces names a piece",
       [](Tree& e) { e["term_pieces"] = integers({1}); }},
      {"law.evaluator.term_pieces names a piece",
       [](Tree& e) { e["term_pieces"] = integers({-1}); }},
      {"law.evaluator.fold has the shape",
       [](Tree& e) {
         e["fold"] = vector({0, 0});
       }},
      {"law.evaluator.fold is neither zero nor",
       [](Tree& e) {
         e["fold"] = vector({0, 1e-170, 0, 0, 0});
       }},
      {"law.evaluator.leaf_care and leaf_bits belong",
       [](Tree& e) {
         e["leaf_care"] = nodes({0, 0}, 2);
       }},
      {"law.evaluator.worst_operations is 168, but", [](Tree& e) { e["worst_operations"] = 168; }},
      {"law.evaluator.node_planes belongs to a tree", [](Tree& e) { e["kind"] = "flat"; }},
      {"law.evaluator.leaf_care names a hyperplane",
       [](Tree& e) {
         make_flat(e);
         e["leaf_care"] = nodes({1, 0, 4, 0, 0, 0}, 2);
       }},
      {"law.evaluator.leaf_care names a hyperplane",
       [](Tree& e) {
         make_flat(e);
         e["leaf_care"] = nodes({1, 1, 2, 0, 0, 0}, 2);
       }},
      {"law.evaluator.leaf_bits asks for bits outside",
       [](Tree& e) {
         make_flat(e);
         e["leaf_bits"] = nodes({1, 0, 1, 0, 0, 0}, 2);
       }},
      {"law.evaluator.leaf_care and leaf_bits do not have",
       [](Tree& e) {
         make_flat(e);
         e["leaf_bits"] = nodes({1, 0}, 2);
       }},
      {"law.evaluator.hyperplanes has more rows than the 64",
       [](Tree& e) {
         make_flat(e);
         e["hyperplanes"] = matrix(65, 6, std::vector<double>(65 * 6, 1.0));
       }},
  };
  for (const Row& row : rows) {
    const std::string text = evaluator_refusal(row.damage);
    EXPECT_NE(text.find(row.named), std::string::npos) << row.named << " <- " << text;
    EXPECT_EQ(text.find("rig.law: "), 0u) << text;
    EXPECT_NE(text.find("design it again"), std::string::npos) << text;
    EXPECT_EQ(text.find('\n'), std::string::npos);
  }
}

TEST(LawTablesSection, PiecesAreChecked) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::pair<const char*, std::function<void(Tree&)>> rows[] = {
      {"law.piece_offset",
       [](Tree& law) {
         law["piece_offset"] = vector({0, 0});
       }},
      {"law.piece_offset holds a number",
       [nan](Tree& law) { law["piece_offset"] = vector({nan}); }},
      {"law.piece_gain holds no piece",
       [](Tree& law) {
         law["piece_gain"] = matrix(0, 5, {});
         law["piece_offset"] = vector({});
       }},
      {"law.piece_gain.shape",
       [](Tree& law) {
         law["piece_gain"]["shape"] = Tree::List{-1, 5};
       }},
      {"law.piece_gain has the shape",
       [](Tree& law) {
         law["piece_gain"]["shape"] = Tree::List{4000000, 5};
       }},
      {"lacks the key evaluator", [](Tree& law) { law.erase("evaluator"); }},
  };
  for (const auto& [named, damage] : rows) {
    const std::string text = refusal(damage);
    EXPECT_NE(text.find(named), std::string::npos) << named << " <- " << text;
  }
}

TEST(LawTablesSection, SharedNodesHaveTheirLongestPathMeasured) {
  const auto tree = [](int depth) {
    return [depth](Tree& e) {
      e["hyperplanes"] = matrix(3, 6, std::vector<double>(18, 1.0));
      std::vector<std::int32_t> planes(21, -1), children(24, -1);
      for (std::size_t i = 0; i < 3; ++i) planes[7 * i] = static_cast<std::int32_t>(i);
      children[0] = 1;
      children[4] = 2;
      children[8] = 2;
      e["node_planes"] = nodes(planes, 7);
      e["node_children"] = nodes(children, 8);
      e["depth"] = depth;
      e["worst_operations"] = 3 * 81 + 88;
    };
  };
  EXPECT_EQ(evaluator_refusal(tree(3)), "");
  EXPECT_NE(evaluator_refusal(tree(2)), "");
}

}  // namespace
}  // namespace eampc::service
