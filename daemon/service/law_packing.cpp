#include "service/law_packing.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <new>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

namespace eampc::service {
namespace {

using control::kLanes;
using control::LeafCode;
using control::PackedLeaf;

constexpr std::align_val_t kLine{64};
constexpr std::size_t kMostBytes = std::size_t{1} << 30;

using Terms = std::vector<std::vector<std::int32_t>>;

std::size_t rows_of(std::size_t count) { return (count + kLanes - 1) / kLanes; }

Terms terms_of(const LawTables& tables, std::size_t leaf) {
  Terms terms;
  for (auto t = static_cast<std::size_t>(tables.leaf_first[leaf]);
       t < static_cast<std::size_t>(tables.leaf_first[leaf + 1]); ++t) {
    terms.emplace_back(tables.term_pieces.begin() + tables.term_first[t],
                       tables.term_pieces.begin() + tables.term_first[t + 1]);
  }
  return terms;
}

// A leaf that is a max or a min of pieces: min over pieces = −max over pieces of −piece.
struct Largest {
  std::vector<std::int32_t> pieces;
  bool negated = false;
};

std::optional<Largest> as_largest(const Terms& terms) {
  if (terms.size() == 1) return Largest{terms.front(), terms.front().size() > 1};
  Largest largest;
  for (const auto& term : terms) {
    if (term.size() > 1) return std::nullopt;
    largest.pieces.push_back(term.front());
  }
  return largest;
}

bool is_lattice(const Terms& terms) {
  const auto largest = as_largest(terms);
  return !largest || rows_of(largest->pieces.size()) > LeafCode::kMostGroups;
}

class Packer {
 public:
  explicit Packer(const LawTables& tables)
      : tables_(tables), np_(static_cast<std::size_t>(tables.n_parameters)) {
    std::vector<Terms> leaves;
    for (std::size_t k = 0; k < tables.n_leaves(); ++k) leaves.push_back(terms_of(tables, k));
    general_ = std::any_of(leaves.begin(), leaves.end(), is_lattice);
    if (general_) pack_pieces();
    for (const Terms& terms : leaves) leaf_codes_.push_back(code_of(terms));
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
    copy(pieces_, law.pieces);
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

  std::uint32_t code_of(const Terms& terms) {
    const auto [known, is_new] = codes_.try_emplace(terms, 0);
    if (is_new) {
      known->second = is_lattice(terms) ? add_lattice(terms) : add_rows(*as_largest(terms));
    }
    return known->second;
  }

  // Eight pieces per row; the last one fills up.
  std::uint32_t add_rows(const Largest& leaf) {
    const std::size_t first_row = row_pieces_.size() / kLanes;
    const std::size_t rows = rows_of(leaf.pieces.size());
    if (first_row + rows >= LeafCode::kMostRows) {
      throw std::invalid_argument("the law's leaves hold too many pieces to be packed");
    }
    const double sign = leaf.negated ? -1.0 : 1.0;
    for (std::size_t first = 0; first < leaf.pieces.size(); first += kLanes) {
      std::array<std::int32_t, kLanes> pieces{};
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        pieces[lane] = leaf.pieces[std::min(first + lane, leaf.pieces.size() - 1)];
      }
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
    most_groups_ = std::max(most_groups_, static_cast<int>(rows));
    return LeafCode::of(static_cast<std::uint32_t>(first_row), static_cast<std::uint32_t>(rows),
                        leaf.negated);
  }

  void pack_pieces() {
    for (std::size_t i = 0; i < tables_.n_pieces(); ++i) {
      const double* gain = tables_.piece_gain.data() + i * np_;
      pieces_.push_back(tables_.piece_offset[i]);
      pieces_.insert(pieces_.end(), gain, gain + np_);
      pieces_.resize((i + 1) * control::piece_stride(np_), -0.0);
    }
  }

  // Eight terms of about the same length stand together.
  std::uint32_t add_lattice(Terms terms) {
    std::stable_sort(terms.begin(), terms.end(),
                     [](const auto& a, const auto& b) { return a.size() > b.size(); });
    std::vector<std::int32_t> pieces;
    for (const auto& term : terms) pieces.insert(pieces.end(), term.begin(), term.end());
    std::sort(pieces.begin(), pieces.end());
    pieces.erase(std::unique(pieces.begin(), pieces.end()), pieces.end());
    const PackedLeaf head = {static_cast<std::uint32_t>(rows_of(pieces.size())),
                             static_cast<std::uint32_t>(rows_of(terms.size()))};
    std::vector<unsigned char> index;
    for (std::size_t first = 0; first < terms.size(); first += kLanes) {
      const std::uint64_t longest = terms[first].size();
      index.resize(index.size() + sizeof(longest));
      std::memcpy(index.data() + index.size() - sizeof(longest), &longest, sizeof(longest));
      for (std::size_t k = 0; k < longest; ++k) {
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
          const auto& term = terms[std::min(first + lane, terms.size() - 1)];
          const std::int32_t piece = term[std::min(k, term.size() - 1)];
          const auto place = std::lower_bound(pieces.begin(), pieces.end(), piece);
          index.push_back(static_cast<unsigned char>(place - pieces.begin()));
        }
      }
    }
    pieces.resize(head.rows * kLanes, pieces.back());
    const std::size_t code = leaves_.size() / PackedLeaf::kBytes;
    const auto append = [&](const void* from, std::size_t bytes) {
      const auto* first = static_cast<const std::byte*>(from);
      leaves_.insert(leaves_.end(), first, first + bytes);
    };
    append(&head, sizeof(head));
    append(pieces.data(), pieces.size() * sizeof(pieces.front()));
    append(index.data(), index.size());
    leaves_.resize((leaves_.size() + PackedLeaf::kBytes - 1) / PackedLeaf::kBytes *
                   PackedLeaf::kBytes);
    if (code >= LeafCode::kMostRows) {
      throw std::invalid_argument("the law's leaves hold too many pieces to be packed");
    }
    return LeafCode::of(static_cast<std::uint32_t>(code), 0, false);
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
    if (tables_.n_nodes() * node_bytes() > kMostBytes) {
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
  std::map<Terms, std::uint32_t> codes_;
  std::vector<std::uint32_t> leaf_codes_;
  std::vector<std::byte> nodes_, leaves_;
  std::vector<double> planes_, rows_, pieces_;
  std::vector<std::uint64_t> matches_;
  std::vector<std::int32_t> row_pieces_;
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
