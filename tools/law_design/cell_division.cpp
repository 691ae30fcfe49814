#include "law_design/cell_division.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace eampc::law_design {
namespace {

// A known point this far beyond a hyperplane, with a ball on the other side, proves a ball there.
constexpr double kClear = 1e-4;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

struct Span {
  double lowest, highest;
};

Span span_over_box(const Hyperplane& plane, const Extent& extent, int parameters) {
  double middle = -plane.offset;
  double reach = 0.0;
  for (int j = 0; j < parameters; ++j) {
    const double a = 0.5 * plane.normal[index(j)];
    middle += a * (extent.upper[index(j)] + extent.lower[index(j)]);
    reach += std::abs(a) * (extent.upper[index(j)] - extent.lower[index(j)]);
  }
  return {middle - reach, middle + reach};
}

}  // namespace

CellDivision::CellDivision(const LawPartition& partition)
    : parameters_(partition.parameters),
      geometry_(partition),
      sides_{Cell(partition.parameters), Cell(partition.parameters)} {}

void CellDivision::enter(const Cell& cell, const Hyperplane& plane) {
  plane_ = plane;
  for (const bool up : {false, true}) {
    sides_[up ? 1 : 0] = cell;
    sides_[up ? 1 : 0].push(plane, up);
  }
}

// The part of `item` on one side: from a point known there if it is well inside, else by a program.
bool CellDivision::other_side(const CellItem& item, bool above, CellItem& part) {
  const double sign = above ? 1.0 : -1.0;
  part.region = item.region;
  part.extent.lower = item.extent.lower;
  part.extent.upper = item.extent.upper;
  const Point* deepest = nullptr;
  double depth = 0.0;
  for (const Point& point : item.extent.points) {
    const double beyond = sign * plane_.excess(point);
    if (beyond <= 0.0) continue;
    part.extent.points.push_back(point);
    if (beyond > depth) {
      depth = beyond;
      deepest = &point;
    }
  }
  const double own = sign * plane_.excess(item.inside);
  if (own >= 0.5 * item.radius && item.radius > kClear) {
    part.inside = item.inside;
    part.radius = std::min(item.radius, own);
  } else if (deepest != nullptr && depth > kClear && item.radius > kClear) {
    // From the deepest point t of the way to the ball: a ball of t times its radius, at a depth of
    // depth − t (depth − own).
    const double t = std::min(1.0, 0.5 * depth / std::max(depth - own, 1e-12));
    for (std::size_t j = 0; j < kMaxDimension; ++j) {
      part.inside[j] = (*deepest)[j] + t * (item.inside[j] - (*deepest)[j]);
    }
    part.radius = std::min(t * item.radius, depth - t * (depth - own));
  } else {
    const CellGeometry::Presence presence = geometry_.presence(sides_[above ? 1 : 0], part);
    if (presence == CellGeometry::Presence::kAbsent) return false;
    part.thin = presence == CellGeometry::Presence::kThin;
    return true;
  }
  part.thin = false;
  return true;
}

DividedItem CellDivision::divide(const CellItem& item, bool measure) {
  const Span span = span_over_box(plane_, item.extent, parameters_);
  DividedItem result;
  if (span.highest <= CellGeometry::kSide) {
    result.whole = DividedItem::Whole::kBelow;
    return result;
  }
  if (span.lowest >= -CellGeometry::kSide) {
    result.whole = DividedItem::Whole::kAbove;
    return result;
  }
  for (const bool up : {false, true}) {
    std::optional<CellItem>& part = result.parts[up ? 1 : 0];
    part.emplace();
    if (!other_side(item, up, *part)) part.reset();
  }
  const bool both = result.parts[0].has_value() && result.parts[1].has_value();
  for (const bool up : {false, true}) {
    if (!result.parts[up ? 1 : 0]) continue;
    CellItem& part = *result.parts[up ? 1 : 0];
    if (!both) part.extent = item.extent;
    if (measure && !part.thin && both) {
      geometry_.refresh_extent(sides_[up ? 1 : 0], part);
    } else if (part.extent.points.size() < kMostPoints && !part.thin) {
      part.extent.points.push_back(part.inside);
    }
  }
  return result;
}

}  // namespace eampc::law_design
