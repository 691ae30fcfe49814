#include "law_design/evaluator_descent.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

AffineForm difference(const AffineForm& a, const AffineForm& b) {
  AffineForm result{};
  for (std::size_t c = 0; c < result.size(); ++c) result[c] = a[c] - b[c];
  return result;
}

AffineForm shifted(AffineForm form, int np, double constant) {
  form[index(np)] += constant;
  return form;
}

AffineForm negative(AffineForm form) {
  for (double& c : form) c = -c;
  return form;
}

}  // namespace

EvaluatorDescent::EvaluatorDescent(const service::LawTables& tables, const LawInTables& law,
                                   double tolerance)
    : tables_(tables),
      law_(law),
      tolerance_(tolerance),
      np_(tables.n_parameters),
      program_(tables.n_parameters),
      cell_(tables.n_parameters),
      extra_(tables.n_parameters),
      mirrored_(tables.n_parameters) {}

// max form·(q, 1) over the cell, from above.
double EvaluatorDescent::support(const AffineForm& form) {
  const HalfSpaces* parts[] = {facets_, &cell_};
  const LpResult result = program_.maximise(form.data(), parts);
  return result.value + form[index(np_)];
}

unsigned EvaluatorDescent::sides(const double* normal, double offset, std::vector<Point>& points) {
  const auto value = [&](const Point& q) {
    double sum = -offset;
    for (int j = 0; j < np_; ++j) sum += normal[j] * q[index(j)];
    return sum;
  };
  unsigned sure = 0;
  for (const Point& q : points) {
    const double v = value(q);
    if (v < -kSide) sure |= 1U;
    if (v > kSide) sure |= 2U;
  }
  if (sure == 3U) return sure;
  double least = -offset;
  double most = -offset;
  for (int j = 0; j < np_; ++j) {
    const double a = normal[j] * lower_[index(j)];
    const double b = normal[j] * upper_[index(j)];
    least += std::min(a, b);
    most += std::max(a, b);
  }
  const HalfSpaces* parts[] = {facets_, &cell_};
  Point c{};
  for (const unsigned side : {1U, 2U}) {
    if ((sure & side) != 0U) continue;
    const double sign = side == 1U ? -1.0 : 1.0;
    if ((side == 1U ? -least : most) <= kSide) continue;
    for (int j = 0; j < np_; ++j) c[index(j)] = sign * normal[j];
    const double limit = sign * offset + kSide;
    const LpResult reach = program_.maximise(c.data(), parts, limit);
    if (reach.status == LpStatus::kBelowCutoff || reach.status == LpStatus::kInfeasible) continue;
    if (reach.status == LpStatus::kOptimal) {
      if (reach.value <= limit) continue;
      Point q{};
      std::copy_n(program_.point(), np_, q.begin());
      points.push_back(q);
    }
    sure |= side;
  }
  // Flatter than kSide: it lies on the plane, where both sides have the same value.
  return sure == 0U ? 1U : sure;
}

template <typename Go>
void EvaluatorDescent::split(int plane, const std::vector<Point>& points, const Go& go) {
  Point normal{};
  law_.planes.copy_normal(plane, normal.data());
  const double offset = law_.planes.offset(plane);
  std::vector<Point> all = points;
  const unsigned found = sides(normal.data(), offset, all);
  if (found != 3U) {
    go(found == 2U, std::move(all));
    return;
  }
  for (const bool above : {false, true}) {
    Point side{};
    for (int j = 0; j < np_; ++j) side[index(j)] = above ? -normal[index(j)] : normal[index(j)];
    std::vector<Point> kept;
    for (const Point& q : all) {
      double v = above ? offset : -offset;
      for (int j = 0; j < np_; ++j) v += side[index(j)] * q[index(j)];
      if (v <= 0.0) kept.push_back(q);
    }
    cell_.append(side.data(), above ? -offset : offset);
    go(above, std::move(kept));
    cell_.pop();
  }
}

void EvaluatorDescent::enter_plane(std::int32_t node, int at, unsigned path,
                                   std::vector<Point> points) {
  if (at >= service::kPlanesPerNode) {
    enter_tree(tables_.node_children[index(node * service::kChildrenPerNode) + path],
               std::move(points));
    return;
  }
  const std::int32_t plane = tables_.node_planes[index(node * service::kPlanesPerNode + at)];
  if (plane < 0) {
    enter_plane(node, 2 * at + 1, 2U * path, std::move(points));
    return;
  }
  split(plane, points, [&](bool above, std::vector<Point> kept) {
    enter_plane(node, 2 * at + (above ? 2 : 1), 2U * path + (above ? 1U : 0U), std::move(kept));
  });
}

void EvaluatorDescent::enter_tree(std::int32_t code, std::vector<Point> points) {
  if (code < 0) {
    reach(~code);
  } else {
    enter_plane(code, 0, 0U, std::move(points));
  }
}

// `known`: planes decided, `above`: how. The first leaf that may still match decides what to ask.
void EvaluatorDescent::enter_flat(std::uint64_t known, std::uint64_t above,
                                  std::vector<Point> points) {
  for (std::size_t leaf = 0; leaf < tables_.leaf_care.size(); ++leaf) {
    const std::uint64_t care = tables_.leaf_care[leaf];
    if (((tables_.leaf_bits[leaf] ^ above) & care & known) != 0) continue;
    if ((tables_.leaf_bits[leaf] & ~care) != 0) continue;
    const std::uint64_t open = care & ~known;
    if (open == 0) {
      reach(static_cast<int>(leaf));
      return;
    }
    const std::uint64_t bit = open & (~open + 1);
    int plane = 0;
    while ((bit >> plane) != 1U) ++plane;
    split(plane, points, [&](bool is_above, std::vector<Point> kept) {
      enter_flat(known | bit, is_above ? above | bit : above, std::move(kept));
    });
    return;
  }
  ++result_.cells;
  ++result_.wrong_cells;
  result_.unmatched = true;
  result_.error = 1.0;
}

bool EvaluatorDescent::same_law(int piece, double tolerance) const {
  const AffineForm d = difference(law_.pieces[index(piece)], output_);
  double sum = 0.0;
  for (int c = 0; c <= np_; ++c) sum += std::abs(d[index(c)]);
  return sum <= tolerance;
}

bool EvaluatorDescent::require_form(const AffineForm& form) {
  double norm = 0.0;
  double reach = form[index(np_)];
  for (int j = 0; j < np_; ++j) {
    norm += form[index(j)] * form[index(j)];
    reach += std::abs(form[index(j)]);
  }
  if (reach < 0.0) return false;
  norm = std::sqrt(norm);
  if (norm < 1e-14) return true;  // true on the whole box, to rounding
  Point normal{};
  for (int j = 0; j < np_; ++j) normal[index(j)] = -form[index(j)] / norm;
  extra_.append(normal.data(), form[index(np_)] / norm);
  return true;
}

bool EvaluatorDescent::no_point(const AffineForm& objective, double cutoff) {
  const HalfSpaces* parts[] = {facets_, &cell_, &extra_};
  const double limit = cutoff - objective[index(np_)];
  const LpResult result = program_.maximise(objective.data(), parts, limit);
  return result.status == LpStatus::kBelowCutoff || result.status == LpStatus::kInfeasible ||
         (result.status == LpStatus::kOptimal && result.value <= limit);
}

// A point where every piece of the term exceeds the clipped law may exist.
bool EvaluatorDescent::too_high(int term, double tolerance) {
  const std::int32_t first = tables_.term_first[index(term)];
  const std::int32_t last = tables_.term_first[index(term + 1)];
  for (std::int32_t i = first; i < last; ++i) {
    if (same_law(tables_.term_pieces[index(i)], tolerance)) return false;
  }
  extra_.clear();
  AffineForm constant{};
  constant[index(np_)] = 1.0 - tolerance;
  if (!require_form(difference(constant, output_))) return false;
  for (std::int32_t i = first; i < last; ++i) {
    const AffineForm& piece = law_.pieces[index(tables_.term_pieces[index(i)])];
    if (!require_form(shifted(piece, np_, -tolerance))) return false;
    if (i > first && !require_form(shifted(difference(piece, output_), np_, -tolerance))) {
      return false;
    }
  }
  const AffineForm& piece = law_.pieces[index(tables_.term_pieces[index(first)])];
  return !no_point(difference(piece, output_), tolerance);
}

// A point where every term from `at` on has a piece below the clipped law may exist.
bool EvaluatorDescent::too_low(std::vector<int>& terms, std::size_t at, double tolerance) {
  const int term = terms[at];
  const std::int32_t first = tables_.term_first[index(term)];
  const std::int32_t last = tables_.term_first[index(term + 1)];
  for (std::int32_t i = first; i < last; ++i) {
    const AffineForm& piece = law_.pieces[index(tables_.term_pieces[index(i)])];
    const int rows = extra_.size();
    bool possible = require_form(shifted(negative(piece), np_, 1.0 - tolerance));
    if (possible) {
      const AffineForm below = difference(output_, piece);
      possible = !no_point(below, tolerance);
      if (possible && at + 1 < terms.size()) {
        possible =
            require_form(shifted(below, np_, -tolerance)) && too_low(terms, at + 1, tolerance);
      }
    }
    while (extra_.size() > rows) extra_.pop();
    if (possible) return true;
  }
  return false;
}

bool EvaluatorDescent::leaf_is_right(int leaf, double tolerance) {
  const int first = tables_.leaf_first[index(leaf)];
  const int last = tables_.leaf_first[index(leaf + 1)];
  if (output_low_ < 1.0 - tolerance) {
    for (int term = first; term < last; ++term) {
      if (too_high(term, tolerance)) return false;
    }
  }
  if (output_high_ <= tolerance) return true;
  // Terms that may be enough alone come first: with one that nowhere falls below, all is said.
  std::vector<int> terms;
  for (int term = first; term < last; ++term) {
    bool own = true;
    for (std::int32_t i = tables_.term_first[index(term)]; i < tables_.term_first[index(term + 1)];
         ++i) {
      own = own && same_law(tables_.term_pieces[index(i)], tolerance);
    }
    if (own) return true;
    terms.push_back(term);
  }
  extra_.clear();
  if (!require_form(shifted(output_, np_, -tolerance))) return true;
  if (terms.size() > 1) {
    for (const int term : terms) {
      if (tables_.term_first[index(term + 1)] - tables_.term_first[index(term)] < 2) continue;
      std::vector<int> alone{term};
      if (!too_low(alone, 0, tolerance)) return true;
    }
  }
  return !too_low(terms, 0, tolerance);
}

void EvaluatorDescent::reach(int leaf) {
  ++result_.cells;
  double error = tolerance_;
  while (error < 1.0 && !leaf_is_right(leaf, error)) error *= 10.0;
  result_.error = std::max(result_.error, std::min(error, 1.0));
  if (error > tolerance_) {
    ++result_.wrong_cells;
    if (result_.wrong_leaf < 0) result_.wrong_leaf = leaf;
  }
}

void EvaluatorDescent::start(const HalfSpaces& facets, const AffineForm& output) {
  facets_ = &facets;
  output_ = output;
  std::vector<Point> points;
  AffineForm axis{};
  for (int j = 0; j < np_; ++j) {
    for (const double sign : {1.0, -1.0}) {
      axis[index(j)] = sign;
      const HalfSpaces* parts[] = {facets_, &cell_};
      const LpResult edge = program_.maximise(axis.data(), parts);
      if (edge.status == LpStatus::kInfeasible) return;  // nothing of it on this side of the fold
      const bool known = edge.status == LpStatus::kOptimal;
      (sign > 0.0 ? upper_ : lower_)[index(j)] =
          known ? std::clamp(sign * edge.value, -1.0, 1.0) : sign;
      if (known) {
        Point q{};
        std::copy_n(program_.point(), np_, q.begin());
        points.push_back(q);
      }
    }
    axis[index(j)] = 0.0;
  }
  output_high_ = support(output_);
  output_low_ = -support(negative(output_));
  if (tables_.flat) {
    enter_flat(0, 0, std::move(points));
  } else {
    enter_tree(tables_.root, std::move(points));
  }
}

EvaluatorDescent::Result EvaluatorDescent::check(const CertifiedRegion& region) {
  result_ = Result{};
  cell_.clear();
  const HalfSpaces& facets = region.polytope.facets;
  if (!law_.folded) {
    start(facets, region.output);
    return result_;
  }
  Point side{};
  for (int j = 0; j < np_; ++j) side[index(j)] = -law_.fold[index(j)];
  cell_.append(side.data(), 0.0);
  start(facets, region.output);
  // The other half is evaluated at −q and negated: −R with the law 1 − y(−q).
  mirrored_.clear();
  for (int i = 0; i < facets.size(); ++i) {
    Point a{};
    for (int j = 0; j < np_; ++j) a[index(j)] = -facets.normal(i, j);
    mirrored_.append(a.data(), facets.offset(i));
  }
  AffineForm output = region.output;
  output[index(np_)] = 1.0 - output[index(np_)];
  start(mirrored_, output);
  return result_;
}

}  // namespace eampc::law_design
