// A leaf whose terms have several pieces: every piece once, then the terms.
// Part of point_location_kernel.hpp, and like it in an unnamed namespace.
#pragma once

#include "control/point_location_lanes.hpp"

namespace eampc::control {
namespace {

// (1, p, 1, …): a piece is the sum of its products with these, in adjacent pairs; the −0 at its end
// leaves every sum as it is. In registers from the start: a vector load of what was just stored in
// parts would wait for the stores of the evaluation before.
template <std::size_t Np>
struct PieceFactors {
#if EAMPC_LANE_WIDTH >= 4
  Part line[kParts];
  double last;  // np = 8: of the gain in a piece's second line

  explicit PieceFactors(const Part* p) noexcept : last(first_lane(p[Np - 1])) {
    const auto factor = [p](std::size_t i) {
      return i == 0 || i > Np ? 1.0 : first_lane(p[i - 1]);
    };
#if EAMPC_LANE_WIDTH == 8
    line[0] = _mm512_set_pd(factor(7), factor(6), factor(5), factor(4), factor(3), factor(2),
                            factor(1), factor(0));
#else
    line[0] = _mm256_set_pd(factor(3), factor(2), factor(1), factor(0));
    line[1] = _mm256_set_pd(factor(7), factor(6), factor(5), factor(4));
#endif
  }
#else
  double of[Np + 1];

  explicit PieceFactors(const Part* p) noexcept {
    of[0] = 1.0;
    for (std::size_t j = 0; j < Np; ++j) of[j + 1] = first_lane(p[j]);
  }
#endif
};

#if EAMPC_LANE_WIDTH == 8
constexpr int kEvenQuarters = 0x88;
constexpr int kOddQuarters = 0xdd;

// Sums of adjacent lanes: a's and b's alternate.
inline Part sums_of_pairs(Part a, Part b) noexcept {
  return _mm512_unpacklo_pd(a, b) + _mm512_unpackhi_pd(a, b);
}

inline Part sums_of_quarters(Part a, Part b) noexcept {
  return _mm512_shuffle_f64x2(a, b, kEvenQuarters) + _mm512_shuffle_f64x2(a, b, kOddQuarters);
}

// First line of eight pieces.
inline Lanes line_sums(const double* const* piece, const Part* factors) noexcept {
  Part products[kLanes];
  for (std::size_t i = 0; i < kLanes; ++i) products[i] = load_part(piece[i]) * factors[0];
  Part pairs[4];
  for (std::size_t i = 0; i < 4; ++i) {
    pairs[i] = sums_of_pairs(products[2 * i], products[2 * i + 1]);
  }
  return {{sums_of_quarters(sums_of_quarters(pairs[0], pairs[1]),
                            sums_of_quarters(pairs[2], pairs[3]))}};
}
#elif EAMPC_LANE_WIDTH == 4
// Sums of four adjacent lanes of each of four.
inline Part sums_of_four(const Part* of) noexcept {
  const Part first = _mm256_hadd_pd(of[0], of[1]);
  const Part second = _mm256_hadd_pd(of[2], of[3]);
  return _mm256_blend_pd(first, second, 0xc) + _mm256_permute2f128_pd(first, second, 0x21);
}

inline Lanes line_sums(const double* const* piece, const Part* factors) noexcept {
  Lanes sums;
  for (std::size_t part = 0; part < kParts; ++part) {
    Part low[kWidth];
    Part high[kWidth];
    for (std::size_t i = 0; i < kWidth; ++i) {
      const double* line = piece[part * kWidth + i];
      low[i] = load_part(line) * factors[0];
      high[i] = load_part(line + kWidth) * factors[1];
    }
    sums.part[part] = sums_of_four(low) + sums_of_four(high);
  }
  return sums;
}
#endif

// Eight pieces by their numbers.
template <std::size_t Np>
inline Lanes pieces_named(const double* pieces, const std::uint32_t* names,
                          const PieceFactors<Np>& factors) noexcept {
  const double* piece[kLanes];
  for (std::size_t i = 0; i < kLanes; ++i) piece[i] = pieces + piece_stride(Np) * names[i];
#if EAMPC_LANE_WIDTH >= 4
  Lanes values = line_sums(piece, factors.line);
  if constexpr (Np == kLanes) {
    double rest[kLanes];
    for (std::size_t i = 0; i < kLanes; ++i) rest[i] = piece[i][Np] * factors.last;
    for (std::size_t part = 0; part < kParts; ++part) {
      values.part[part] = values.part[part] + load_part(rest + part * kWidth);
    }
  }
  return values;
#else
  double values[kLanes];
  for (std::size_t i = 0; i < kLanes; ++i) {
    double products[Np + 1];
    for (std::size_t j = 0; j <= Np; ++j) products[j] = piece[i][j] * factors.of[j];
    values[i] = pairwise<Np + 1>(products);
  }
  Lanes lanes;
  __builtin_memcpy(&lanes, values, sizeof(lanes));
  return lanes;
#endif
}

// values[index[lane]] in every lane; `rows` of eight values.
#if EAMPC_LANE_WIDTH == 8
class Values {
 public:
  Values(const double* values, std::size_t rows) noexcept : values_(values), rows_(rows) {
    for (std::size_t row = 0; row < kHeld; ++row) held_[row] = row_or_last(row);
  }

  Lanes at(const unsigned char* index) const noexcept {
    const __m512i at =
        _mm512_cvtepu8_epi64(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(index)));
    Part found = _mm512_permutex2var_pd(held_[0], at, held_[1]);
    take_from(found, at, 2, held_[2], held_[3]);
    for (std::size_t row = kHeld; row < rows_; row += 2) {
      take_from(found, at, row, row_or_last(row), row_or_last(row + 1));
    }
    return {{found}};
  }

 private:
  static constexpr std::size_t kHeld = 4;

  Part row_or_last(std::size_t row) const noexcept {
    return load_part(values_ + (row < rows_ ? row : rows_ - 1) * kLanes);
  }
  static void take_from(Part& found, __m512i at, std::size_t row, Part even, Part odd) noexcept {
    const __m512i first = _mm512_set1_epi64(static_cast<long long>(row * kLanes));
    const __mmask8 here = _mm512_cmpge_epu64_mask(at, first);
    found = _mm512_mask_mov_pd(found, here, _mm512_permutex2var_pd(even, at, odd));
  }

  const double* values_;
  std::size_t rows_;
  Part held_[kHeld];
};
#else
class Values {
 public:
  Values(const double* values, std::size_t) noexcept : values_(values) {}

  Lanes at(const unsigned char* index) const noexcept {
    Lanes found;
    for (std::size_t part = 0; part < kParts; ++part) {
      const unsigned char* of = index + part * kWidth;
#if EAMPC_LANE_WIDTH == 4
      found.part[part] =
          _mm256_set_pd(values_[of[3]], values_[of[2]], values_[of[1]], values_[of[0]]);
#elif EAMPC_LANE_WIDTH == 2
      found.part[part] = Part{values_[of[0]], values_[of[1]]};
#else
      found.part[part] = values_[of[0]];
#endif
    }
    return found;
  }

 private:
  const double* values_;
};
#endif

// Eight terms: the smallest value of each.
inline Lanes smallest_of_terms(const Values& values, const unsigned char* index,
                               std::size_t longest) noexcept {
  Lanes term = values.at(index);
  for (std::size_t k = 1; k < longest; ++k) {
    const Lanes more = values.at(index + k * kLanes);
    for (std::size_t part = 0; part < kParts; ++part) {
      term.part[part] = smaller(more.part[part], term.part[part]);
    }
  }
  return term;
}

// The first of the pieces that has the value u; -1 if p is NaN.
inline std::int32_t piece_with(double u, const double* values, const std::uint32_t* names,
                               std::size_t rows) noexcept {
  constexpr std::size_t kRowsAtOnce = 8;
  const Part wanted = every_lane(u);
  for (std::size_t first = 0; first < rows; first += kRowsAtOnce) {
    const std::size_t end = first + kRowsAtOnce < rows ? first + kRowsAtOnce : rows;
    std::uint64_t found = 0;
    for (std::size_t row = first; row < end; ++row) {
      for (std::size_t part = 0; part < kParts; ++part) {
        const Part value = load_part(values + row * kLanes + part * kWidth);
        found |= std::uint64_t{equal_bits(value, wanted)}
                 << ((row - first) * kLanes + part * kWidth);
      }
    }
    if (found == 0) continue;
    return static_cast<std::int32_t>(
        names[first * kLanes + static_cast<std::size_t>(__builtin_ctzll(found))]);
  }
  return -1;
}

template <std::size_t Np>
inline LawValue lattice_leaf(const PackedLaw& law, const Part* p, std::uint32_t place,
                             double sign) noexcept {
  const std::byte* at = law.leaves.data() + std::size_t{place} * PackedLeaf::kBytes;
  PackedLeaf leaf;
  __builtin_memcpy(&leaf, at, sizeof(leaf));
  const auto* names = reinterpret_cast<const std::uint32_t*>(at + sizeof(leaf));
  const auto* index = reinterpret_cast<const unsigned char*>(names + leaf.rows * kLanes);
  const PieceFactors<Np> factors(p);
  alignas(64) double values[PackedLeaf::kMostPieces];
  for (std::size_t row = 0; row < leaf.rows; ++row) {
    const Lanes value = pieces_named<Np>(law.pieces.data(), names + row * kLanes, factors);
    __builtin_memcpy(values + row * kLanes, &value, sizeof(value));
  }
  const Values table(values, leaf.rows);
  Lanes best = eight_lanes(-__builtin_inf());
  for (std::size_t group = 0; group < leaf.groups; ++group) {
    std::uint64_t longest = 0;
    __builtin_memcpy(&longest, index, sizeof(longest));
    const Lanes terms = smallest_of_terms(table, index + sizeof(longest), longest);
    for (std::size_t part = 0; part < kParts; ++part) {
      best.part[part] = larger(terms.part[part], best.part[part]);
    }
    index += sizeof(longest) + longest * kLanes;
  }
  const double u = largest(best);
  const std::int32_t piece = piece_with(u, values, names, leaf.rows);
  if (piece < 0) return kNone;
  return {sign * u, piece};
}

}  // namespace
}  // namespace eampc::control
