#include "law_design/cell_contents.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

void Cell::push(const Hyperplane& plane, bool above) {
  const double sign = above ? -1.0 : 1.0;
  std::array<double, kMaxDimension + 1> a{};
  for (int j = 0; j < dimension_; ++j) a[index(j)] = sign * plane.normal[index(j)];
  rows_.append(a.data(), sign * plane.offset);
  a[index(dimension_)] = 1.0;
  ball_.append(a.data(), sign * plane.offset);
}

void Cell::pop() {
  rows_.pop();
  ball_.pop();
}

CellGeometry::CellGeometry(const OutputLaws& laws)
    : laws_(laws),
      dimension_(laws.parameters),
      program_(laws.parameters),
      ball_(laws.parameters + 1) {
  ball_.set_bounds(dimension_, -4.0, 2.0);
  ball_.set_perturbation(1e-12);
}

CellGeometry::Presence CellGeometry::presence(int region, const Cell& cell) {
  std::array<double, kMaxDimension + 1> c{};
  c[index(dimension_)] = 1.0;
  const HalfSpaces* parts[] = {&laws_.regions[index(region)].ball_facets, &cell.ball_rows()};
  const LpResult ball = ball_.maximise(c.data(), parts, -kThin);
  if (ball.status == LpStatus::kFailed) return Presence::kThere;
  if (ball.status != LpStatus::kOptimal) return Presence::kAbsent;
  return ball_.point()[dimension_] > kThin ? Presence::kThere : Presence::kThin;
}

std::shared_ptr<const Extent> CellGeometry::extent(int region, const Cell& cell) {
  auto result = std::make_shared<Extent>();
  const HalfSpaces* parts[] = {&laws_.regions[index(region)].facets, &cell.rows()};
  for (int j = 0; j < dimension_; ++j) {
    result->lower[index(j)] = -1.0;
    result->upper[index(j)] = 1.0;
    for (const double sign : {1.0, -1.0}) {
      Point c{};
      c[index(j)] = sign;
      const LpResult edge = program_.maximise(c.data(), parts);
      if (edge.status != LpStatus::kOptimal) continue;
      (sign > 0.0 ? result->upper : result->lower)[index(j)] = sign * edge.value;
      Point point{};
      for (int i = 0; i < dimension_; ++i) point[index(i)] = program_.point()[i];
      result->points.push_back(point);
    }
  }
  return result;
}

bool CellGeometry::touches(const Hyperplane& plane, const CellItem& item) const {
  double middle = -plane.offset;
  double reach = 0.0;
  for (std::size_t j = 0; j < index(dimension_); ++j) {
    const double a = 0.5 * plane.normal[j];
    middle += a * (item.extent->upper[j] + item.extent->lower[j]);
    reach += std::abs(a) * (item.extent->upper[j] - item.extent->lower[j]);
  }
  return std::abs(middle) <= reach + kSide;
}

unsigned CellGeometry::possible_sides(const Hyperplane& plane, const CellItem& item,
                                      unsigned* sure) const {
  const Extent& extent = *item.extent;
  double middle = -plane.offset;
  double reach = 0.0;
  for (std::size_t j = 0; j < index(dimension_); ++j) {
    const double a = 0.5 * plane.normal[j];
    middle += a * (extent.upper[j] + extent.lower[j]);
    reach += std::abs(a) * (extent.upper[j] - extent.lower[j]);
  }
  *sure = 0;
  if (middle + reach <= kSide) return kBelow;
  if (middle - reach >= -kSide) return kAbove;
  for (const Point& point : extent.points) {
    double excess = -plane.offset;
    for (std::size_t j = 0; j < index(dimension_); ++j) excess += plane.normal[j] * point[j];
    if (excess > kSide) *sure |= kAbove;
    if (excess < -kSide) *sure |= kBelow;
    if (*sure == kBoth) break;
  }
  return kBoth;
}

unsigned CellGeometry::proved_sides(const Hyperplane& plane, const CellItem& item, const Cell& cell,
                                    unsigned possible, unsigned sure) {
  const HalfSpaces* parts[] = {&laws_.regions[index(item.region)].facets, &cell.rows()};
  const auto excluded = [&](double sign) {
    Point c{};
    for (std::size_t j = 0; j < c.size(); ++j) c[j] = sign * plane.normal[j];
    const double bound = sign * plane.offset + kSide;
    const LpResult result = program_.maximise(c.data(), parts, bound);
    return result.status == LpStatus::kBelowCutoff ||
           (result.status == LpStatus::kOptimal && result.value <= bound);
  };
  if ((possible & kAbove) != 0U && (sure & kAbove) == 0U && excluded(1.0)) possible &= ~kAbove;
  if (possible == kBoth && (sure & kBelow) == 0U && excluded(-1.0)) possible &= ~kBelow;
  return possible;
}

bool CellGeometry::difference_below(int law_a, int law_b, const CellItem& item, const Cell& cell,
                                    double bound) {
  const ScaledLaw& a = laws_.laws[index(law_a)];
  const ScaledLaw& b = laws_.laws[index(law_b)];
  Point c{};
  for (std::size_t j = 0; j < c.size(); ++j) c[j] = a[j] - b[j];
  const HalfSpaces* parts[] = {&laws_.regions[index(item.region)].facets, &cell.rows()};
  const double limit = bound - (a[kMaxDimension] - b[kMaxDimension]);
  double reach = 0.0;
  for (std::size_t j = 0; j < index(dimension_); ++j) {
    const double edge = c[j] > 0.0 ? (item.extent ? item.extent->upper[j] : 1.0)
                                   : (item.extent ? item.extent->lower[j] : -1.0);
    reach += c[j] * edge;
  }
  if (reach <= limit) return true;
  const LpResult result = program_.maximise(c.data(), parts, limit);
  return result.status == LpStatus::kBelowCutoff || result.status == LpStatus::kInfeasible ||
         (result.status == LpStatus::kOptimal && result.value <= limit);
}

double CellGeometry::first_output(const Point& start, const CellItem& target,
                                  const std::vector<CellItem>& items) const {
  Point direction{};
  for (const Point& point : target.extent->points) {
    for (std::size_t j = 0; j < direction.size(); ++j) {
      direction[j] += point[j] / static_cast<double>(target.extent->points.size());
    }
  }
  for (std::size_t j = 0; j < direction.size(); ++j) direction[j] -= start[j];
  double first = std::numeric_limits<double>::infinity();
  double value = 0.5;
  for (const CellItem& item : items) {
    const LawRegion& region = laws_.regions[index(item.region)];
    double enter = 0.0;
    double leave = std::numeric_limits<double>::infinity();
    for (int f = 0; f < region.facets.size() && enter <= leave; ++f) {
      const double slack = region.facets.offset(f) - region.facets.product(f, start.data());
      const double speed = region.facets.product(f, direction.data());
      if (std::abs(speed) < 1e-14) {
        if (slack < 0.0) leave = -1.0;
      } else if (speed > 0.0) {
        leave = std::min(leave, slack / speed);
      } else {
        enter = std::max(enter, slack / speed);
      }
    }
    if (enter > leave || enter >= first) continue;
    first = enter;
    Point at{};
    for (std::size_t j = 0; j < at.size(); ++j) at[j] = start[j] + enter * direction[j];
    value = laws_.value(region.law, at.data());
  }
  return value;
}

bool CellGeometry::centre(const Cell& cell, Point* centre) {
  std::array<double, kMaxDimension + 1> c{};
  c[index(dimension_)] = 1.0;
  HalfSpaces box(dimension_ + 1);
  for (int j = 0; j < 2 * dimension_; ++j) {
    std::array<double, kMaxDimension + 1> a{};
    a[index(j / 2)] = j % 2 == 0 ? 1.0 : -1.0;
    a[index(dimension_)] = 1.0;
    box.append(a.data(), 1.0);
  }
  const HalfSpaces* parts[] = {&cell.ball_rows(), &box};
  const LpResult result = ball_.maximise(c.data(), parts, kThinCell);
  if (result.status != LpStatus::kOptimal) return false;
  for (int j = 0; j < dimension_; ++j) (*centre)[index(j)] = ball_.point()[j];
  return true;
}

}  // namespace eampc::law_design
