// The evaluation of point_location.hpp over EAMPC_LANE_WIDTH doubles at a time: included once by
// each point_location_*.cpp, which is compiled for one instruction set. Everything stands in an
// unnamed namespace: what is compiled here for a newer processor must not be picked by the linker
// for code that runs on every one.
#pragma once

#include "control/point_location_lanes.hpp"
#include "control/point_location_lattice.hpp"

namespace eampc::control {
namespace {

constexpr std::size_t kMatchesAtOnce = 64;
constexpr std::size_t kRowBytes = kLanes * sizeof(double);

// p in every lane, as given: with `turn` (−0 in every lane, else 0) −p is meant. A sum of products
// with −p is the negative of the sum with p to the bit, so hyperplanes need not wait for the fold.
template <std::size_t Np>
struct Point {
  Part p[Np];
  Part turn;

  // Empty `fold`: as given. What was just stored must not be read back here as a whole: that would
  // wait for the stores, so the fold is computed in every lane.
  Point(const double* from, std::span<const double> fold) noexcept : turn(every_lane(0.0)) {
    for (std::size_t j = 0; j < Np; ++j) p[j] = every_lane(from[j]);
    if (fold.size() == 0) return;
    Part terms[Np];
    for (std::size_t j = 0; j < Np; ++j) terms[j] = every_lane(fold.data()[j]) * p[j];
    turn = signs_below_zero(pairwise<Np>(terms));
  }

  // −1 where −p is meant, else 1.
  double sign() const noexcept { return first_lane(signs_changed(every_lane(1.0), turn)); }

  // −p itself, where that is meant.
  Point turned() const noexcept {
    Point point = *this;
    for (std::size_t j = 0; j < Np; ++j) point.p[j] = signs_changed(p[j], turn);
    point.turn = every_lane(0.0);
    return point;
  }

  // Bits of the eight hyperplanes (np normals, then offsets) that p is above of.
  unsigned above(const double* planes) const noexcept {
    unsigned bits = 0;
    for (std::size_t part = 0; part < kParts; ++part) {
      const double* at = planes + part * kWidth;
      Part terms[Np];
      for (std::size_t j = 0; j < Np; ++j) terms[j] = load_part(at + j * kLanes) * p[j];
      const Part product = signs_changed(pairwise<Np>(terms), turn);
      bits |= above_bits(product, load_part(at + Np * kLanes)) << (part * kWidth);
    }
    return bits;
  }

  // Eight pieces (offsets, then np gains), of a point that is turned already.
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
  Best best{point.pieces(row), eight_lanes(0.0)};
  if (law.most_groups == 2) {
    take_larger(best, point.pieces(row + (groups - 1) * kRow), eight_lanes(1.0));
  } else {
    for (std::size_t group = 1; group < groups; ++group) {
      take_larger(best, point.pieces(row + group * kRow), eight_lanes(static_cast<double>(group)));
    }
  }
  return first_largest(law, best, first, sign * kSigns[code & 1U]);
}

template <std::size_t Np, bool kGeneral>
inline LawValue leaf_value(const PackedLaw& law, const Point<Np>& point,
                           std::uint32_t code) noexcept {
  const Point<Np> turned = point.turned();
  if constexpr (kGeneral) {
    if (LeafCode::groups(code) == 0) {
      return lattice_leaf<Np>(law, turned.p, LeafCode::first_row(code), point.sign());
    }
  }
  return simple_leaf<Np>(law, turned, code, point.sign());
}

template <std::size_t Np, bool kGeneral>
inline LawValue tree_value(const PackedLaw& law, const Point<Np>& point) noexcept {
  const std::byte* nodes = law.nodes.data();
  std::int32_t at = law.root;
  for (int level = 0; at >= 0 && level < law.depth; ++level) {
    const double* node = reinterpret_cast<const double*>(nodes + at);
    const std::byte* children = nodes + at + (Np + 1) * kRowBytes;
    __builtin_prefetch(children);  // wanted as soon as the hyperplanes are compared
    const unsigned path = kPaths.of[point.above(node)];
    __builtin_memcpy(&at, children + path * sizeof(at), sizeof(at));
  }
  if (at >= 0) return kNone;
  return leaf_value<Np, kGeneral>(law, point, static_cast<std::uint32_t>(~at));
}

template <std::size_t Np, bool kGeneral>
inline LawValue flat_value(const PackedLaw& law, const Point<Np>& point) noexcept {
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
    return leaf_value<Np, kGeneral>(law, point, law.flat_leaves.data()[leaf]);
  }
  return kNone;
}

template <std::size_t Np, bool kFlat, bool kGeneral>
LawValue law_value(const PackedLaw& law, const double* p) noexcept EAMPC_NONBLOCKING {
  const Point<Np> point(p, law.fold);
  if constexpr (kFlat) {
    return flat_value<Np, kGeneral>(law, point);
  } else {
    return tree_value<Np, kGeneral>(law, point);
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
