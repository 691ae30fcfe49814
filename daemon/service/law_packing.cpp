#include "service/law_packing.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <new>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

namespace eampc::service {
namespace {

using control::kLanes;
using control::LeafCode;

constexpr std::align_val_t kLine{64};

// A leaf as terms, each a list of pieces; negated: −max over terms of (min of −piece).
struct Leaf {
  std::vector<std::vector<std::int32_t>> terms;
  bool negated = false;

  bool single_pieces() const {
    return std::all_of(terms.begin(), terms.end(), [](const auto& t) { return t.size() == 1; });
  }
  std::size_t groups() const { return (terms.size() + kLanes - 1) / kLanes; }
  auto operator<=>(const Leaf&) const = default;
};

// min over pieces = −max over pieces of −piece: a leaf of one term becomes one of one-piece terms.
Leaf leaf_of(const LawTables& tables, std::size_t k) {
  Leaf leaf;
  for (auto t = static_cast<std::size_t>(tables.leaf_first[k]);
       t < static_cast<std::size_t>(tables.leaf_first[k + 1]); ++t) {
    leaf.terms.emplace_back(tables.term_pieces.begin() + tables.term_first[t],
                            tables.term_pieces.begin() + tables.term_first[t + 1]);
  }
  if (leaf.terms.size() == 1 && leaf.terms.front().size() > 1) {
    const std::vector<std::int32_t> pieces = std::move(leaf.terms.front());
    leaf.terms.clear();
    for (const std::int32_t piece : pieces) leaf.terms.push_back({piece});
    leaf.negated = true;
  }
  // Eight terms of about the same length stand together.
  std::stable_sort(leaf.terms.begin(), leaf.terms.end(),
                   [](const auto& a, const auto& b) { return a.size() > b.size(); });
  return leaf;
}

class Packer {
 public:
  explicit Packer(const LawTables& tables)
      : tables_(tables), np_(static_cast<std::size_t>(tables.n_parameters)) {
    std::vector<Leaf> leaves;
    for (std::size_t k = 0; k < tables.n_leaves(); ++k) leaves.push_back(leaf_of(tables, k));
    general_ = std::any_of(leaves.begin(), leaves.end(), [](const Leaf& leaf) {
      return !leaf.single_pieces() || leaf.groups() > LeafCode::kMostGroups;
    });
    for (const Leaf& leaf : leaves) leaf_codes_.push_back(code_of(leaf));
    if (tables.flat) {
      pack_flat();
    } else {
      pack_nodes();
    }
  }

  control::LawShape shape() const { return {tables_.flat, general_}; }

  // Bytes of one block, or with `memory` the block filled and the spans of `law` set.
  std::size_t place(std::byte* memory, control::PackedLaw& law) const {
    std::size_t at = 0;
    const auto copy = [&](const auto& values, auto& span) {
      using T = typename std::decay_t<decltype(values)>::value_type;
      const std::size_t bytes = values.size() * sizeof(T);
      if (memory != nullptr && bytes > 0) {
        std::memcpy(memory + at, values.data(), bytes);
        span = {reinterpret_cast<const T*>(memory + at), values.size()};
      }
      at += (bytes + 63) / 64 * 64;
    };
    copy(nodes_, law.nodes);
    copy(planes_, law.planes);
    copy(matches_, law.matches);
    if (tables_.flat) copy(leaf_codes_, law.flat_leaves);
    copy(leaves_, law.leaves);
    copy(group_rows_, law.group_rows);
    copy(rows_, law.rows);
    copy(row_pieces_, law.row_pieces);
    const bool folds =
        std::any_of(tables_.fold.begin(), tables_.fold.end(), [](double f) { return f != 0.0; });
    if (folds) copy(tables_.fold, law.fold);
    law.n_parameters = tables_.n_parameters;
    law.depth = tables_.depth;
    law.root = tables_.flat ? -1 : child(tables_.root);
    law.most_groups = most_groups_;
    return at;
  }

 private:
  std::size_t node_bytes() const { return (np_ + 2) * kLanes * sizeof(double); }

  std::int32_t child(std::int32_t code) const {
    if (code < 0) return ~static_cast<std::int32_t>(leaf_codes_[static_cast<std::size_t>(~code)]);
    return static_cast<std::int32_t>(static_cast<std::size_t>(code) * node_bytes());
  }

  std::uint32_t code_of(const Leaf& leaf) {
    const auto [known, is_new] = codes_.try_emplace(leaf, 0);
    if (!is_new) return known->second;
    const std::size_t first_row = row_pieces_.size() / kLanes;
    const std::size_t first_group = group_rows_.size();
    for (std::size_t first = 0; first < leaf.terms.size(); first += kLanes) add_group(leaf, first);
    if (row_pieces_.size() / kLanes >= LeafCode::kMostRows) {
      throw std::invalid_argument("the law's leaves hold too many pieces to be packed");
    }
    const auto row = static_cast<std::uint32_t>(first_row);
    const auto groups = static_cast<std::uint32_t>(leaf.groups());
    most_groups_ = std::max(most_groups_, static_cast<int>(groups));
    if (general_) {
      known->second = static_cast<std::uint32_t>(leaves_.size());
      leaves_.push_back({row, static_cast<std::uint32_t>(first_group), groups, leaf.negated});
    } else {
      known->second = LeafCode::of(row, groups, leaf.negated);
    }
    return known->second;
  }

  // Eight terms from `first` on; a short term repeats its last piece, the last term fills up.
  void add_group(const Leaf& leaf, std::size_t first) {
    const std::size_t rows = leaf.terms[first].size();
    for (std::size_t row = 0; row < rows; ++row) {
      std::array<std::int32_t, kLanes> pieces{};
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const auto& term = leaf.terms[std::min(first + lane, leaf.terms.size() - 1)];
        pieces[lane] = term[std::min(row, term.size() - 1)];
      }
      const double sign = leaf.negated ? -1.0 : 1.0;
      for (const std::int32_t piece : pieces) {
        rows_.push_back(sign * tables_.piece_offset[static_cast<std::size_t>(piece)]);
      }
      for (std::size_t j = 0; j < np_; ++j) {
        for (const std::int32_t piece : pieces) {
          rows_.push_back(sign * tables_.piece_gain[static_cast<std::size_t>(piece) * np_ + j]);
        }
      }
      row_pieces_.insert(row_pieces_.end(), pieces.begin(), pieces.end());
    }
    group_rows_.push_back(static_cast<std::uint32_t>(rows));
  }

  // Eight hyperplanes side by side; −1 is one that every finite p is below of.
  void add_planes(std::span<const std::int32_t> planes, std::vector<double>& to) const {
    for (std::size_t j = 0; j <= np_; ++j) {
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const std::int32_t plane = lane < planes.size() ? planes[lane] : -1;
        to.push_back(
            plane < 0 ? 0.0 : tables_.hyperplanes[static_cast<std::size_t>(plane) * (np_ + 1) + j]);
      }
    }
  }

  void pack_nodes() {
    if (tables_.n_nodes() * node_bytes() > std::size_t{1} << 30) {
      throw std::invalid_argument("the law's tree is too large to be packed");
    }
    nodes_.resize(tables_.n_nodes() * node_bytes());
    for (std::size_t i = 0; i < tables_.n_nodes(); ++i) {
      std::vector<double> planes;
      add_planes(std::span(tables_.node_planes).subspan(i * kPlanesPerNode, kPlanesPerNode),
                 planes);
      std::array<std::int32_t, kChildrenPerNode> children{};
      for (std::size_t k = 0; k < children.size(); ++k) {
        children[k] = child(tables_.node_children[i * kChildrenPerNode + k]);
      }
      std::byte* node = nodes_.data() + i * node_bytes();
      std::memcpy(node, planes.data(), planes.size() * sizeof(double));
      std::memcpy(node + planes.size() * sizeof(double), children.data(), sizeof(children));
    }
  }

  void pack_flat() {
    std::vector<std::int32_t> planes;
    for (std::size_t first = 0; first < tables_.n_planes(); first += kLanes) {
      planes.clear();
      for (std::size_t i = first; i < std::min(first + kLanes, tables_.n_planes()); ++i) {
        planes.push_back(static_cast<std::int32_t>(i));
      }
      add_planes(planes, planes_);
    }
    // A match that fills up asks for a bit that its care leaves out: none.
    for (std::size_t first = 0; first < tables_.n_leaves(); first += kLanes) {
      for (std::size_t k = first; k < first + kLanes; ++k) {
        matches_.push_back(k < tables_.n_leaves() ? tables_.leaf_care[k] : 0);
      }
      for (std::size_t k = first; k < first + kLanes; ++k) {
        matches_.push_back(k < tables_.n_leaves() ? tables_.leaf_bits[k] : 1);
      }
    }
  }

  const LawTables& tables_;
  std::size_t np_;
  bool general_ = false;
  int most_groups_ = 0;
  std::map<Leaf, std::uint32_t> codes_;
  std::vector<std::uint32_t> leaf_codes_;
  std::vector<std::byte> nodes_;
  std::vector<double> planes_, rows_;
  std::vector<std::uint64_t> matches_;
  std::vector<std::int32_t> row_pieces_;
  std::vector<control::PackedLeaf> leaves_;
  std::vector<std::uint32_t> group_rows_;
};

}  // namespace

control::EvaluationPath evaluation_path(const std::string& name) {
  using control::EvaluationPath;
  constexpr std::array<std::pair<const char*, EvaluationPath>, 5> kNames = {
      {{"best", EvaluationPath::kBest},
       {"scalar", EvaluationPath::kScalar},
       {"vector128", EvaluationPath::kVector128},
       {"avx2", EvaluationPath::kAvx2},
       {"avx512", EvaluationPath::kAvx512}}};
  for (const auto& [known, path] : kNames) {
    if (name == known) return path;
  }
  throw std::invalid_argument("evaluation path \"" + name +
                              "\" is not one of best, scalar, vector128, avx2, avx512");
}

LawPacking::LawPacking(const LawTables& tables, control::EvaluationPath path) {
  if (const auto defect = find_defect(tables)) {
    throw std::invalid_argument(defect->key + " " + defect->what);
  }
  const Packer packer(tables);
  law_.function = control::evaluation(tables.n_parameters, packer.shape(), path);
  if (law_.function == nullptr) {
    throw std::invalid_argument("this processor lacks the evaluation path that was asked for");
  }
  bytes_ = packer.place(nullptr, law_);
  memory_.reset(static_cast<std::byte*>(::operator new(std::max<std::size_t>(bytes_, 64), kLine)));
  packer.place(memory_.get(), law_);
}

void LawPacking::Release::operator()(std::byte* memory) const noexcept {
  ::operator delete(memory, kLine);
}

}  // namespace eampc::service
