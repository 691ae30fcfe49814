#include "law_design/double_arena.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

DoubleArena::DoubleArena(int dimension)
    : program(dimension), ball(dimension + 1), cell(dimension), rows(dimension) {
  ball.set_bounds(dimension, -4.0, 2.0);
}

double DoubleArena::radius(const Form& form, double limit) {
  const int n = rows.dimension();
  HalfSpaces lifted(n + 1);
  std::array<double, kMaxDimension + 1> a{};
  const auto lift = [&](double offset) {
    double norm = 0.0;
    for (int j = 0; j < n; ++j) norm += a[index(j)] * a[index(j)];
    norm = std::sqrt(norm);
    if (norm == 0.0) return;
    for (int j = 0; j < n; ++j) a[index(j)] /= norm;
    a[index(n)] = 1.0;
    lifted.append(a.data(), offset / norm);
  };
  const HalfSpaces* parts[] = {facets, &cell, &rows};
  for (const HalfSpaces* part : parts) {
    for (int i = 0; i < part->size(); ++i) {
      part->copy_normal(i, a.data());
      lift(part->offset(i));
    }
  }
  for (int side = 0; side < 2 * n; ++side) {
    a.fill(0.0);
    a[index(side / 2)] = side % 2 == 0 ? 1.0 : -1.0;
    lift(1.0);
  }
  for (int j = 0; j < n; ++j) a[index(j)] = -form[index(j)];
  lift(form[index(n)] - limit);
  a.fill(0.0);
  a[index(n)] = 1.0;
  const LpResult result = ball.maximise(a.data(), lifted);
  if (result.status == LpStatus::kInfeasible) return 0.0;
  return result.status == LpStatus::kOptimal ? std::max(result.value, 0.0) : 1.0;
}

void DoubleArena::add(const Form& form) {
  Point normal{};
  const int n = rows.dimension();
  for (int j = 0; j < n; ++j) normal[index(j)] = -form[index(j)];
  rows.append(normal.data(), form[index(n)]);
}

bool DoubleArena::below(const Form& form, double limit) {
  const HalfSpaces* parts[] = {facets, &cell, &rows};
  return !reaches(form, limit, parts, nullptr);
}

bool DoubleArena::reaches(const Form& form, double limit, std::span<const HalfSpaces* const> parts,
                          Point* point) {
  const double cutoff = limit - form[index(rows.dimension())];
  const LpResult result = program.maximise(form.data(), parts, cutoff);
  if (point != nullptr) std::copy_n(program.point(), rows.dimension(), point->begin());
  return result.status == LpStatus::kFailed ||
         (result.status == LpStatus::kOptimal && result.value > cutoff);
}

}  // namespace eampc::law_design
