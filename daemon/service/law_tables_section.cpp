#include <limits>
#include <string>

#include "service/law_cost.hpp"
#include "service/law_sections.hpp"

namespace eampc::service {
namespace {

constexpr std::string_view kEvaluatorPrefix = "evaluator.";

[[noreturn]] void fail(const LawValue& law, const LawTablesDefect& defect) {
  if (defect.key.starts_with(kEvaluatorPrefix)) {
    law.at("evaluator").at(defect.key.substr(kEvaluatorPrefix.size())).fail(defect.what);
  }
  law.at(defect.key).fail(defect.what);
}

// Pairs of low and high 32 bits.
std::vector<std::uint64_t> masks(const LawValue& value) {
  const std::vector<std::int32_t> halves = value.integers({-1, 2});
  std::vector<std::uint64_t> masks(halves.size() / 2);
  for (std::size_t k = 0; k < masks.size(); ++k) {
    masks[k] = static_cast<std::uint32_t>(halves[2 * k]) |
               std::uint64_t{static_cast<std::uint32_t>(halves[2 * k + 1])} << 32;
  }
  return masks;
}

}  // namespace

LawTables read_law_tables(const LawValue& law, int np) {
  constexpr std::int64_t kLast = std::numeric_limits<std::int32_t>::max();
  const LawValue evaluator = law.at("evaluator");
  LawTables tables;
  tables.n_parameters = np;
  tables.flat = evaluator.at("kind").choice({"tree", "flat"}) == 1;
  tables.piece_gain = law.at("piece_gain").doubles({-1, np});
  tables.piece_offset =
      law.at("piece_offset")
          .doubles({static_cast<std::int64_t>(tables.piece_gain.size()) / std::int64_t{np}});
  tables.hyperplanes = evaluator.at("hyperplanes").doubles({-1, np + 1});
  tables.root = static_cast<std::int32_t>(evaluator.at("root").integer(-kLast - 1, kLast));
  tables.depth = static_cast<int>(evaluator.at("depth").integer(0, kLast));
  tables.node_planes = evaluator.at("node_planes").integers({-1, kPlanesPerNode});
  tables.node_children = evaluator.at("node_children").integers({-1, kChildrenPerNode});
  tables.leaf_care = masks(evaluator.at("leaf_care"));
  tables.leaf_bits = masks(evaluator.at("leaf_bits"));
  tables.leaf_first = evaluator.at("leaf_first").integers({-1});
  tables.term_first = evaluator.at("term_first").integers({-1});
  tables.term_pieces = evaluator.at("term_pieces").integers({-1});
  tables.fold = evaluator.at("fold").doubles({np});
  if (const auto defect = find_defect(tables)) fail(law, *defect);
  const std::int64_t stated =
      evaluator.at("worst_operations").integer(0, std::numeric_limits<std::int64_t>::max());
  const std::int64_t counted = evaluation_cost(tables);
  if (stated != counted) {
    evaluator.at("worst_operations")
        .fail("is " + std::to_string(stated) + ", but an evaluation of these tables takes up to " +
              std::to_string(counted));
  }
  return tables;
}

}  // namespace eampc::service
