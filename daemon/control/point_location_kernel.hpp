// The evaluation of point_location.hpp over EAMPC_LANE_WIDTH doubles at a time: included once by
// each point_location_*.cpp, which is compiled for one instruction set. Everything stands in an
// unnamed namespace: what is compiled here for a newer processor must not be picked by the linker
// for code that runs on every one.
#pragma once

#include "control/point_location.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

namespace eampc::control {
namespace {

constexpr std::size_t kWidth = EAMPC_LANE_WIDTH;
constexpr std::size_t kParts = kLanes / kWidth;
constexpr std::size_t kMatchesAtOnce = 64;
constexpr std::size_t kRowBytes = kLanes * sizeof(double);

#if EAMPC_LANE_WIDTH == 1
using Part = double;
#else
typedef double Part __attribute__((vector_size(8 * EAMPC_LANE_WIDTH)));
typedef long long PartBits __attribute__((vector_size(8 * EAMPC_LANE_WIDTH)));
#endif

// Eight lanes as one to eight registers.
struct Lanes {
  Part part[kParts];
};

inline Part load_part(const double* from) noexcept {
  Part part;
  __builtin_memcpy(&part, from, sizeof(Part));
  return part;
}

inline Part every_lane(double value) noexcept {
#if EAMPC_LANE_WIDTH == 1
  return value;
#else
  return value - Part{};
#endif
}

// Bits of the lanes in which !(a ≤ b): NaN counts as above.
inline unsigned above_bits(Part a, Part b) noexcept {
#if EAMPC_LANE_WIDTH == 8
  return _mm512_cmp_pd_mask(a, b, _CMP_NLE_UQ);
#elif EAMPC_LANE_WIDTH == 4
  return static_cast<unsigned>(_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_NLE_UQ)));
#elif EAMPC_LANE_WIDTH == 2 && defined(__x86_64__)
  return static_cast<unsigned>(_mm_movemask_pd(_mm_cmpnle_pd(a, b)));
#elif EAMPC_LANE_WIDTH == 2
  const PartBits below = a <= b;
  return static_cast<unsigned>((below[0] + 1) | ((below[1] + 1) << 1));
#else
  return a <= b ? 0U : 1U;
#endif
}

inline unsigned equal_bits(Part a, Part b) noexcept {
#if EAMPC_LANE_WIDTH == 8
  return _mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ);
#elif EAMPC_LANE_WIDTH == 4
  return static_cast<unsigned>(_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_EQ_OQ)));
#elif EAMPC_LANE_WIDTH == 2 && defined(__x86_64__)
  return static_cast<unsigned>(_mm_movemask_pd(_mm_cmpeq_pd(a, b)));
#elif EAMPC_LANE_WIDTH == 2
  const PartBits equal = a == b;
  return static_cast<unsigned>(-equal[0] | (-equal[1] << 1));
#else
  return a == b ? 1U : 0U;
#endif
}

// a > b ? a : b in every lane, whatever the signs of zeros.
inline Part larger(Part a, Part b) noexcept {
#if EAMPC_LANE_WIDTH == 8
  return _mm512_max_pd(a, b);
#elif EAMPC_LANE_WIDTH == 4
  return _mm256_max_pd(a, b);
#elif EAMPC_LANE_WIDTH == 2 && defined(__x86_64__)
  return _mm_max_pd(a, b);
#else
  return a > b ? a : b;
#endif
}

// The largest of eight lanes: lane i with i + 4, then i + 2, then i + 1.
inline double largest(const Lanes& lanes) noexcept {
#if EAMPC_LANE_WIDTH == 8
  const __m256d four = _mm256_max_pd(_mm512_castpd512_pd256(lanes.part[0]),
                                     _mm512_extractf64x4_pd(lanes.part[0], 1));
  const __m128d two = _mm_max_pd(_mm256_castpd256_pd128(four), _mm256_extractf128_pd(four, 1));
  return _mm_cvtsd_f64(_mm_max_sd(two, _mm_unpackhi_pd(two, two)));
#elif EAMPC_LANE_WIDTH == 4
  const __m256d four = larger(lanes.part[0], lanes.part[1]);
  const __m128d two = _mm_max_pd(_mm256_castpd256_pd128(four), _mm256_extractf128_pd(four, 1));
  return _mm_cvtsd_f64(_mm_max_sd(two, _mm_unpackhi_pd(two, two)));
#elif EAMPC_LANE_WIDTH == 2
  const Part two =
      larger(larger(lanes.part[0], lanes.part[2]), larger(lanes.part[1], lanes.part[3]));
  return two[0] > two[1] ? two[0] : two[1];
#else
  double four[4];
  for (int i = 0; i < 4; ++i) four[i] = larger(lanes.part[i], lanes.part[i + 4]);
  return larger(larger(four[0], four[2]), larger(four[1], four[3]));
#endif
}

// Bits of the eight leaves whose `care` bits of the mask are their `bits`.
inline unsigned matching(std::uint64_t mask, const std::uint64_t* care,
                         const std::uint64_t* bits) noexcept {
  unsigned found = 0;
#if EAMPC_LANE_WIDTH == 8
  const __m512i all = _mm512_set1_epi64(static_cast<long long>(mask));
  found = _mm512_cmpeq_epi64_mask(_mm512_and_si512(all, _mm512_loadu_si512(care)),
                                  _mm512_loadu_si512(bits));
#elif EAMPC_LANE_WIDTH == 4
  const __m256i all = _mm256_set1_epi64x(static_cast<long long>(mask));
  for (std::size_t part = 0; part < kParts; ++part) {
    const auto* of = reinterpret_cast<const __m256i*>(care + part * kWidth);
    const auto* is = reinterpret_cast<const __m256i*>(bits + part * kWidth);
    const __m256i equal =
        _mm256_cmpeq_epi64(_mm256_and_si256(all, _mm256_loadu_si256(of)), _mm256_loadu_si256(is));
    const int here = _mm256_movemask_pd(_mm256_castsi256_pd(equal));
    found |= static_cast<unsigned>(here) << (part * kWidth);
  }
#else
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    found |= ((mask & care[lane]) == bits[lane] ? 1U : 0U) << lane;
  }
#endif
  return found;
}

// Sum of Count terms in adjacent pairs, level by level.
template <std::size_t Count, typename Term>
inline Term pairwise(const Term* terms) noexcept {
  if constexpr (Count == 1) {
    return terms[0];
  } else {
    constexpr std::size_t kHalf = Count / 2 + Count % 2;
    Term sums[kHalf];
    for (std::size_t i = 0; i < Count / 2; ++i) sums[i] = terms[2 * i] + terms[2 * i + 1];
    if constexpr (Count % 2 != 0) sums[kHalf - 1] = terms[Count - 1];
    return pairwise<kHalf>(sums);
  }
}

// p in every lane.
template <std::size_t Np>
struct Point {
  Part p[Np];

  explicit Point(const double* from) noexcept {
    for (std::size_t j = 0; j < Np; ++j) p[j] = every_lane(from[j]);
  }

  // Bits of the eight hyperplanes (np normals, then offsets) that p is above of.
  unsigned above(const double* planes) const noexcept {
    unsigned bits = 0;
    for (std::size_t part = 0; part < kParts; ++part) {
      const double* at = planes + part * kWidth;
      Part terms[Np];
      for (std::size_t j = 0; j < Np; ++j) terms[j] = load_part(at + j * kLanes) * p[j];
      bits |= above_bits(pairwise<Np>(terms), load_part(at + Np * kLanes)) << (part * kWidth);
    }
    return bits;
  }

  // Eight pieces (offsets, then np gains).
  Lanes pieces(const double* row) const noexcept {
    Lanes values;
    for (std::size_t part = 0; part < kParts; ++part) {
      const double* at = row + part * kWidth;
      Part terms[Np + 1];
      terms[0] = load_part(at);
      for (std::size_t j = 0; j < Np; ++j) terms[j + 1] = load_part(at + (j + 1) * kLanes) * p[j];
      values.part[part] = pairwise<Np + 1>(terms);
    }
    return values;
  }
};

constexpr LawValue kNone{__builtin_nan(""), -1};

// Way out of a node by the bits of its seven planes, in heap order.
struct Paths {
  unsigned char of[256];
};

constexpr Paths node_paths() {
  Paths paths{};
  for (unsigned bits = 0; bits < 256; ++bits) {
    const unsigned first = bits & 1U;
    const unsigned second = (bits >> (1U + first)) & 1U;
    const unsigned third = (bits >> (3U + 2U * first + second)) & 1U;
    paths.of[bits] = static_cast<unsigned char>(4U * first + 2U * second + third);
  }
  return paths;
}

constexpr Paths kPaths = node_paths();

struct Best {
  Lanes value;
  Lanes row;  // whole numbers: the row that gave each lane's value, counted from the leaf's first
};

// The largest of eight lanes, and the piece of the first lane that has it.
inline LawValue first_largest(const PackedLaw& law, const Best& best, std::size_t first_row,
                              double sign) noexcept {
  const double u = largest(best.value);
  unsigned bits = 0;
  for (std::size_t part = 0; part < kParts; ++part) {
    bits |= equal_bits(best.value.part[part], every_lane(u)) << (part * kWidth);
  }
  if (bits == 0) return kNone;  // NaN
  const auto lane = static_cast<std::size_t>(__builtin_ctz(bits));
  double rows[kLanes];
  __builtin_memcpy(rows, &best.row, sizeof(rows));
  const std::size_t row = first_row + static_cast<std::size_t>(rows[lane]);
  return {sign * u, law.row_pieces.data()[row * kLanes + lane]};
}

// Keeps in `best` the larger of it and a row's values, the earlier of equal ones.
inline void take_larger(Best& best, const Lanes& value, const Lanes& row) noexcept {
  for (std::size_t part = 0; part < kParts; ++part) {
    const Part old = best.value.part[part];
    const Part now = value.part[part];
    best.row.part[part] = now > old ? row.part[part] : best.row.part[part];
    best.value.part[part] = larger(now, old);
  }
}

inline void take_smaller(Best& best, const Lanes& value, const Lanes& row) noexcept {
  for (std::size_t part = 0; part < kParts; ++part) {
    const Part old = best.value.part[part];
    const Part now = value.part[part];
    best.row.part[part] = now < old ? row.part[part] : best.row.part[part];
    best.value.part[part] = now < old ? now : old;
  }
}

inline Lanes every_lane_of_row(double row) noexcept {
  Lanes lanes;
  for (std::size_t part = 0; part < kParts; ++part) lanes.part[part] = every_lane(row);
  return lanes;
}

constexpr double kSigns[2] = {1.0,
                              -1.0};  // a table: of a max and a min leaf no branch knows before

// Terms of one piece each, or one term stored negated: the largest piece of some rows. Of two rows
// the second is the last one: for a leaf of one row the same again, cheaper than a branch that is
// hard to foresee.
template <std::size_t Np>
inline LawValue simple_leaf(const PackedLaw& law, const Point<Np>& point, std::uint32_t code,
                            double sign) noexcept {
  constexpr std::size_t kRow = (Np + 1) * kLanes;
  const std::size_t first = LeafCode::first_row(code);
  const std::size_t groups = LeafCode::groups(code);
  const double* row = law.rows.data() + first * kRow;
  Best best{point.pieces(row), every_lane_of_row(0.0)};
  if (law.most_groups == 2) {
    take_larger(best, point.pieces(row + (groups - 1) * kRow), every_lane_of_row(1.0));
  } else {
    for (std::size_t group = 1; group < groups; ++group) {
      take_larger(best, point.pieces(row + group * kRow),
                  every_lane_of_row(static_cast<double>(group)));
    }
  }
  return first_largest(law, best, first, sign * kSigns[code & 1U]);
}

// Terms of several pieces: eight terms per group, one piece of each per row.
template <std::size_t Np>
inline LawValue general_leaf(const PackedLaw& law, const Point<Np>& point, std::uint32_t code,
                             double sign) noexcept {
  constexpr std::size_t kRow = (Np + 1) * kLanes;
  const PackedLeaf& leaf = law.leaves.data()[code];
  const double* row = law.rows.data() + leaf.first_row * kRow;
  Best best{};
  double number = 0.0;
  for (std::uint32_t group = 0; group < leaf.groups; ++group) {
    const std::uint32_t rows = law.group_rows.data()[leaf.first_group + group];
    Best term{point.pieces(row), every_lane_of_row(number)};
    for (std::uint32_t k = 1; k < rows; ++k) {
      take_smaller(term, point.pieces(row + k * kRow), every_lane_of_row(number + k));
    }
    if (group == 0) {
      best = term;
    } else {
      take_larger(best, term.value, term.row);
    }
    row += rows * kRow;
    number += rows;
  }
  return first_largest(law, best, leaf.first_row, leaf.negated ? -sign : sign);
}

template <std::size_t Np, bool kGeneral>
inline LawValue leaf_value(const PackedLaw& law, const Point<Np>& point, std::uint32_t code,
                           double sign) noexcept {
  if constexpr (kGeneral) {
    return general_leaf<Np>(law, point, code, sign);
  } else {
    return simple_leaf<Np>(law, point, code, sign);
  }
}

template <std::size_t Np, bool kGeneral>
inline LawValue tree_value(const PackedLaw& law, const Point<Np>& point, double sign) noexcept {
  const std::byte* nodes = law.nodes.data();
  std::int32_t at = law.root;
  for (int level = 0; at >= 0 && level < law.depth; ++level) {
    const double* node = reinterpret_cast<const double*>(nodes + at);
    const unsigned path = kPaths.of[point.above(node)];
    const std::byte* children = nodes + at + (Np + 1) * kRowBytes;
    __builtin_memcpy(&at, children + path * sizeof(at), sizeof(at));
  }
  if (at >= 0) return kNone;
  return leaf_value<Np, kGeneral>(law, point, static_cast<std::uint32_t>(~at), sign);
}

template <std::size_t Np, bool kGeneral>
inline LawValue flat_value(const PackedLaw& law, const Point<Np>& point, double sign) noexcept {
  constexpr std::size_t kPlanes = (Np + 1) * kLanes;
  const double* planes = law.planes.data();
  const std::size_t n_planes = law.planes.size();
  std::uint64_t mask = 0;
  for (std::size_t at = 0, shift = 0; at < n_planes; at += kPlanes, shift += kLanes) {
    mask |= std::uint64_t{point.above(planes + at)} << shift;
  }
  // Up to 64 leaves at a time without a branch: which of them matches first is hard to foresee.
  const std::uint64_t* matches = law.matches.data();
  const std::size_t n_leaves = law.matches.size() / 2;
  for (std::size_t first = 0; first < n_leaves; first += kMatchesAtOnce) {
    const std::size_t rest = n_leaves - first;
    const std::size_t end = first + (rest < kMatchesAtOnce ? rest : kMatchesAtOnce);
    std::uint64_t found = 0;
    for (std::size_t leaf = first; leaf < end; leaf += kLanes) {
      const std::uint64_t* care = matches + 2 * leaf;
      found |= std::uint64_t{matching(mask, care, care + kLanes)} << (leaf - first);
    }
    if (found == 0) continue;
    const std::size_t leaf = first + static_cast<std::size_t>(__builtin_ctzll(found));
    return leaf_value<Np, kGeneral>(law, point, law.flat_leaves.data()[leaf], sign);
  }
  return kNone;
}

template <std::size_t Np, bool kFlat, bool kGeneral>
LawValue law_value(const PackedLaw& law, const double* p) noexcept {
  double sign = 1.0;
  double turned[Np];
  if (law.fold.size() != 0) {
    double terms[Np];
    for (std::size_t j = 0; j < Np; ++j) terms[j] = law.fold.data()[j] * p[j];
    sign = pairwise<Np>(terms) < 0.0 ? -1.0 : 1.0;
    for (std::size_t j = 0; j < Np; ++j) turned[j] = sign * p[j];
    p = turned;
  }
  const Point<Np> point(p);
  if constexpr (kFlat) {
    return flat_value<Np, kGeneral>(law, point, sign);
  } else {
    return tree_value<Np, kGeneral>(law, point, sign);
  }
}

template <std::size_t Np>
PackedLaw::Function function_of(LawShape shape) noexcept {
  if (shape.flat) {
    return shape.general_leaves ? law_value<Np, true, true> : law_value<Np, true, false>;
  }
  return shape.general_leaves ? law_value<Np, false, true> : law_value<Np, false, false>;
}

PackedLaw::Function function_of(int n_parameters, LawShape shape) noexcept {
  switch (n_parameters) {
    case 1:
      return function_of<1>(shape);
    case 2:
      return function_of<2>(shape);
    case 3:
      return function_of<3>(shape);
    case 4:
      return function_of<4>(shape);
    case 5:
      return function_of<5>(shape);
    case 6:
      return function_of<6>(shape);
    case 7:
      return function_of<7>(shape);
    case 8:
      return function_of<8>(shape);
    default:
      return nullptr;
  }
}

}  // namespace
}  // namespace eampc::control
