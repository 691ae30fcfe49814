#include "law_design/law_in_tables.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>

namespace eampc::law_design {
namespace {

using service::LawTables;

void require(bool condition, const char* sentence) {
  if (!condition) throw std::invalid_argument(sentence);
}

// first[k] .. first[k+1] are not empty and end at `size`.
bool cuts(const std::vector<std::int32_t>& first, std::size_t size) {
  return !first.empty() && first.front() == 0 && static_cast<std::size_t>(first.back()) == size &&
         std::adjacent_find(first.begin(), first.end(), std::greater_equal<>()) == first.end();
}

bool in_range(std::int32_t value, std::size_t size) {
  return value >= 0 && static_cast<std::size_t>(value) < size;
}

void check(const LawTables& t, std::size_t np) {
  const std::size_t pieces = t.piece_offset.size();
  const std::size_t planes = t.hyperplanes.size() / (np + 1);
  require(static_cast<std::size_t>(t.n_parameters) == np && t.piece_gain.size() == pieces * np &&
              t.hyperplanes.size() == planes * (np + 1) && t.fold.size() == np,
          "certificate: the evaluator's tables do not fit the problem's parameters");
  require(cuts(t.term_first, t.term_pieces.size()) && cuts(t.leaf_first, t.term_first.size() - 1),
          "certificate: the evaluator's leaves are not cut into terms of pieces");
  for (const std::int32_t piece : t.term_pieces) {
    require(in_range(piece, pieces), "certificate: a leaf names a piece that does not exist");
  }
  const std::size_t leaves = t.leaf_first.size() - 1;
  const std::size_t nodes = t.node_planes.size() / service::kPlanesPerNode;
  if (t.flat) {
    require(planes <= 64 && t.leaf_care.size() == leaves && t.leaf_bits.size() == leaves,
            "certificate: the flat evaluator's masks do not fit its leaves");
    for (const std::uint64_t care : t.leaf_care) {
      require(planes == 64 || care >> planes == 0,
              "certificate: a mask names a hyperplane that does not exist");
    }
    return;
  }
  require(t.node_planes.size() == nodes * service::kPlanesPerNode &&
              t.node_children.size() == nodes * service::kChildrenPerNode,
          "certificate: the evaluator's nodes are not whole");
  const auto exists = [&](std::int32_t code) {
    return code >= 0 ? in_range(code, nodes) : in_range(~code, leaves);
  };
  require(exists(t.root) && std::all_of(t.node_children.begin(), t.node_children.end(), exists),
          "certificate: the evaluator names a node or leaf that does not exist");
  for (const std::int32_t plane : t.node_planes) {
    require(plane == -1 || in_range(plane, planes),
            "certificate: a node names a hyperplane that does not exist");
  }
}

}  // namespace

LawInTables law_in_tables(const LawTables& tables, const CertificateProblem& problem,
                          const OutputLaw& output) {
  const std::size_t np = static_cast<std::size_t>(problem.parameters);
  check(tables, np);
  const auto scaled = [&](const double* gain, long double constant) {
    ExtendedForm form{};
    form[np] = constant;
    for (std::size_t j = 0; j < np; ++j) {
      const Eigen::Index c = static_cast<Eigen::Index>(j);
      form[j] = static_cast<long double>(gain[j]) * problem.half_width(c);
      form[np] += static_cast<long double>(gain[j]) * problem.centre(c);
    }
    return form;
  };
  const auto slope = [np](const ExtendedForm& form) {
    long double sum = 0.0L;
    for (std::size_t j = 0; j < np; ++j) sum += form[j] * form[j];
    return std::sqrt(sum);
  };
  const auto rounded = [](const ExtendedForm& form) {
    AffineForm result{};
    for (std::size_t c = 0; c < form.size(); ++c) result[c] = static_cast<double>(form[c]);
    return result;
  };
  LawInTables law;
  law.planes = HalfSpaces(problem.parameters);
  for (std::size_t i = 0; i < tables.hyperplanes.size(); i += np + 1) {
    ExtendedForm form = scaled(&tables.hyperplanes[i], -tables.hyperplanes[i + np]);
    const long double norm = slope(form);
    require(norm > 0.0L && std::isfinite(norm) && std::isfinite(form[np]),
            "certificate: a hyperplane of the evaluator is no hyperplane");
    for (long double& c : form) c /= norm;
    const AffineForm plane = rounded(form);
    law.planes.append(plane.data(), -plane[np]);
    law.extended_planes.push_back(form);
  }
  const double range = output.y_max - output.y_min;
  for (std::size_t k = 0; k < tables.piece_offset.size(); ++k) {
    ExtendedForm form = scaled(&tables.piece_gain[k * np],
                               static_cast<long double>(tables.piece_offset[k]) - output.y_min);
    for (long double& c : form) {
      c /= range;
      require(std::isfinite(c), "certificate: a piece holds a number that is not finite");
    }
    law.steepest_piece = std::max(law.steepest_piece, static_cast<double>(slope(form)));
    law.pieces.push_back(rounded(form));
    law.extended_pieces.push_back(form);
  }
  double norm = 0.0;
  for (std::size_t j = 0; j < np; ++j) {
    law.fold[j] = tables.fold[j] * problem.half_width(static_cast<Eigen::Index>(j));
    norm += law.fold[j] * law.fold[j];
  }
  norm = std::sqrt(norm);
  law.folded =
      std::any_of(tables.fold.begin(), tables.fold.end(), [](double a) { return a != 0.0; });
  if (law.folded) {
    require(std::isnormal(norm), "certificate: the fold's normal has no length that can be used");
    require(problem.centre.isZero(0.0) && output.y_min == -output.y_max,
            "certificate: the law is folded, but its box or its range is not symmetric about 0");
    for (double& a : law.fold) a /= norm;
  }
  return law;
}

int tree_depth(const LawTables& tables) {
  if (tables.flat || tables.root < 0) return 0;
  constexpr int kUnseen = -1;
  constexpr int kOpen = -2;
  std::vector<int> height(tables.node_planes.size() / service::kPlanesPerNode, kUnseen);
  std::vector<std::int32_t> path{tables.root};
  while (!path.empty()) {
    const std::size_t node = static_cast<std::size_t>(path.back());
    height[node] = kOpen;
    int most = 0;
    bool waiting = false;
    for (std::size_t c = 0; c < service::kChildrenPerNode; ++c) {
      const std::int32_t child = tables.node_children[node * service::kChildrenPerNode + c];
      if (child < 0) continue;
      const int known = height[static_cast<std::size_t>(child)];
      require(known != kOpen, "certificate: a path of the tree runs in a circle");
      if (known == kUnseen && !waiting) {
        path.push_back(child);
        waiting = true;
      }
      most = std::max(most, known);
    }
    if (waiting) continue;
    height[node] = most + 1;
    path.pop_back();
  }
  return height[static_cast<std::size_t>(tables.root)];
}

}  // namespace eampc::law_design
