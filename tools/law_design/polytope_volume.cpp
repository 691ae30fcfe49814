#include "law_design/polytope_volume.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace eampc::law_design {
namespace {

struct Row {
  std::array<double, kMostVolumeDimensions> normal{};
  double offset = 0.0;
};

// Σ h_i A_i / n, h_i the signed distance of facet i from the origin (any origin will do). A facet
// is projected along the axis its normal is steepest in, which scales its area by that slope.
double volume(const std::vector<Row>& rows, int n) {
  if (n == 1) {
    double lower = -2.0;
    double upper = 2.0;
    for (const Row& row : rows) {
      const double a = row.normal[0];
      if (std::abs(a) < 1e-14) {
        if (row.offset < 0.0) return 0.0;
        continue;
      }
      if (a > 0.0) upper = std::min(upper, row.offset / a);
      if (a < 0.0) lower = std::max(lower, row.offset / a);
    }
    return std::max(upper - lower, 0.0);
  }
  double sum = 0.0;
  for (std::size_t facet = 0; facet < rows.size(); ++facet) {
    const Row& plane = rows[facet];
    int out = 0;
    for (int j = 1; j < n; ++j) {
      const auto at = [&](int k) { return std::abs(plane.normal[static_cast<std::size_t>(k)]); };
      if (at(j) > at(out)) out = j;
    }
    const double pivot = plane.normal[static_cast<std::size_t>(out)];
    if (std::abs(pivot) < 1e-14) continue;
    std::vector<Row> reduced;
    bool twin = false;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (i == facet) continue;
      const double factor = rows[i].normal[static_cast<std::size_t>(out)] / pivot;
      Row row;
      row.offset = rows[i].offset - factor * plane.offset;
      double size = 0.0;
      for (int j = 0, at = 0; j < n; ++j) {
        if (j == out) continue;
        const double a = rows[i].normal[static_cast<std::size_t>(j)] -
                         factor * plane.normal[static_cast<std::size_t>(j)];
        row.normal[static_cast<std::size_t>(at++)] = a;
        size = std::max(size, std::abs(a));
      }
      // The same plane again: counted at its first row.
      twin = twin || (i < facet && size < 1e-13 && std::abs(row.offset) < 1e-13 && factor > 0.0);
      reduced.push_back(row);
    }
    if (twin) continue;
    sum += plane.offset / std::abs(pivot) * volume(reduced, n - 1);
  }
  return sum / n;
}

}  // namespace

double polytope_volume(const HalfSpaces& half_spaces) {
  const int n = half_spaces.dimension();
  std::vector<Row> rows;
  for (int i = 0; i < half_spaces.size(); ++i) {
    Row row;
    half_spaces.copy_normal(i, row.normal.data());
    row.offset = half_spaces.offset(i);
    rows.push_back(row);
  }
  for (int side = 0; side < 2 * n; ++side) {
    Row row;
    row.normal[static_cast<std::size_t>(side / 2)] = side % 2 == 0 ? 1.0 : -1.0;
    row.offset = 1.0;
    rows.push_back(row);
  }
  return volume(rows, n);
}

}  // namespace eampc::law_design
