#include "law_design/facet_plane.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

using Form = std::array<long double, kMaxDimension + 1>;

}  // namespace

FacetPlane::FacetPlane(int parameters) : parameters_(parameters), ball_(parameters - 1) {}

void FacetPlane::set(const double* normal, double offset) {
  std::copy_n(normal, parameters_, normal_.begin());
  offset_ = offset;
  eliminated_ = 0;
  for (int j = 1; j < parameters_; ++j) {
    if (std::abs(normal_[index(j)]) > std::abs(normal_[index(eliminated_)])) eliminated_ = j;
  }
}

FacetPiece FacetPlane::whole() const {
  FacetPiece piece;
  piece.rows = HalfSpaces(parameters_ - 1);
  for (const long double side : {1.0L, -1.0L}) {
    Form form{};
    form[index(eliminated_)] = side;
    form[index(parameters_)] = 1.0L;
    append(piece, form.data());
  }
  return piece;
}

void FacetPlane::append(FacetPiece& piece, const long double* form) const {
  const int np = parameters_;
  const long double factor = form[eliminated_] / normal_[index(eliminated_)];
  Point normal{};
  long double norm = 0.0L;
  for (int j = 0, at = 0; j < np; ++j) {
    if (j == eliminated_) continue;
    const long double a = -(form[j] - factor * normal_[index(j)]);
    norm += a * a;
    normal[index(at++)] = static_cast<double>(a);
  }
  const long double b = form[np] + factor * offset_;
  norm = std::sqrt(norm);
  long double scale = 0.0L;
  for (int j = 0; j <= np; ++j) scale = std::max(scale, std::abs(form[j]));
  if (norm <= 1e-14L * scale) {
    if (b < -1e-12L * scale) piece.empty = true;
    return;
  }
  for (double& a : normal) a = static_cast<double>(a / norm);
  piece.rows.append(normal.data(), static_cast<double>(b / norm));
}

void FacetPlane::append_above(FacetPiece& piece, const long double* form,
                              const long double* exit) const {
  long double rise = 0.0L;
  long double fall = 0.0L;
  for (int j = 0; j < parameters_; ++j) {
    rise += form[j] * normal_[index(j)];
    fall -= exit[j] * normal_[index(j)];
  }
  Form moved{};
  for (int c = 0; c <= parameters_; ++c) moved[index(c)] = form[c] + rise / fall * exit[c];
  append(piece, moved.data());
}

double FacetPlane::radius(const FacetPiece& piece) {
  if (piece.empty) return -1.0;
  Point a{};
  ball_.clear();
  for (int i = 0; i < piece.rows.size(); ++i) {
    piece.rows.copy_normal(i, a.data());
    ball_.append(a.data(), piece.rows.offset(i));
  }
  const LpResult ball = ball_.find();
  if (ball.status == LpStatus::kInfeasible) return -1.0;
  return ball.status == LpStatus::kOptimal ? ball.value : 1.0;  // not decided: not thin
}

double FacetPlane::residual(std::span<const double> form, std::span<const double> plane) {
  double along = 0.0;
  double squared = 0.0;
  for (std::size_t c = 0; c < plane.size(); ++c) {
    along += form[c] * plane[c];
    squared += plane[c] * plane[c];
  }
  along /= squared;
  double sum = 0.0;
  for (std::size_t c = 0; c < plane.size(); ++c) sum += std::abs(form[c] - along * plane[c]);
  return sum;
}

}  // namespace eampc::law_design
