// EAMPC_LANE_WIDTH doubles at a time, eight side by side: what the evaluation does with them. Part
// of point_location_kernel.hpp, and like it in an unnamed namespace.
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

inline Lanes eight_lanes(double value) noexcept {
  Lanes lanes;
  for (std::size_t part = 0; part < kParts; ++part) lanes.part[part] = every_lane(value);
  return lanes;
}

inline double first_lane(Part part) noexcept {
#if EAMPC_LANE_WIDTH == 1
  return part;
#else
  return part[0];
#endif
}

// −0 in the lanes below 0, else 0: without a branch, which of them is hard to foresee.
inline Part signs_below_zero(Part part) noexcept {
#if EAMPC_LANE_WIDTH == 1
  const std::uint64_t bits = static_cast<std::uint64_t>(part < 0.0) << 63;
  __builtin_memcpy(&part, &bits, sizeof(part));
  return part;
#else
  return part < Part{} ? every_lane(-0.0) : Part{};
#endif
}

// −part where `change` is −0, part where it is 0.
inline Part signs_changed(Part part, Part change) noexcept {
#if EAMPC_LANE_WIDTH == 1
  std::uint64_t bits, signs;
  __builtin_memcpy(&bits, &part, sizeof(bits));
  __builtin_memcpy(&signs, &change, sizeof(signs));
  bits ^= signs;
  __builtin_memcpy(&part, &bits, sizeof(bits));
  return part;
#else
  return reinterpret_cast<Part>(reinterpret_cast<PartBits>(part) ^
                                reinterpret_cast<PartBits>(change));
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

// a < b ? a : b in every lane.
inline Part smaller(Part a, Part b) noexcept {
#if EAMPC_LANE_WIDTH == 8
  return _mm512_min_pd(a, b);
#elif EAMPC_LANE_WIDTH == 4
  return _mm256_min_pd(a, b);
#elif EAMPC_LANE_WIDTH == 2 && defined(__x86_64__)
  return _mm_min_pd(a, b);
#else
  return a < b ? a : b;
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

constexpr LawValue kNone{__builtin_nan(""), -1};

}  // namespace
}  // namespace eampc::control
