#include "law_design/evaluator_descent.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

AffineForm negative(AffineForm form) {
  for (double& c : form) c = -c;
  return form;
}

}  // namespace

bool ExtendedArena::below(const Form& form, long double limit) {
  std::vector<const ExtendedForm*> all;
  for (const auto* part : {&facets, &cell, &rows}) {
    for (const ExtendedForm& row : *part) all.push_back(&row);
  }
  return program.below(all, form, limit);
}

EvaluatorDescent::EvaluatorDescent(const CertificateProblem& problem,
                                   const service::LawTables& tables, const LawInTables& law,
                                   double tolerance, bool quick)
    : tables_(tables),
      law_(law),
      tolerance_(tolerance),
      np_(tables.n_parameters),
      certifier_(problem),
      arena_(tables.n_parameters),
      extended_(tables.n_parameters),
      quick_(tables, law.pieces, arena_, tolerance),
      quick_used_(quick),
      mirrored_(tables.n_parameters) {}

// max form·(q, 1) over the cell, from above.
double EvaluatorDescent::support(const AffineForm& form) {
  const HalfSpaces* parts[] = {facets_, &arena_.cell};
  const LpResult result = arena_.program.maximise(form.data(), parts);
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
  const HalfSpaces* parts[] = {facets_, &arena_.cell};
  Point c{};
  for (const unsigned side : {1U, 2U}) {
    if ((sure & side) != 0U) continue;
    const double sign = side == 1U ? -1.0 : 1.0;
    if ((side == 1U ? -least : most) <= kSide) continue;
    for (int j = 0; j < np_; ++j) c[index(j)] = sign * normal[j];
    const double limit = sign * offset + kSide;
    const LpResult reach = arena_.program.maximise(c.data(), parts, limit);
    if (reach.status == LpStatus::kBelowCutoff || reach.status == LpStatus::kInfeasible) continue;
    if (reach.status == LpStatus::kOptimal) {
      if (reach.value <= limit) continue;
      Point q{};
      std::copy_n(arena_.program.point(), np_, q.begin());
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
    arena_.cell.append(side.data(), above ? -offset : offset);
    ExtendedForm beyond = law_.extended_planes[index(plane)];
    if (!above) {
      for (long double& c : beyond) c = -c;
    }
    extended_cell_.push_back(beyond);
    go(above, std::move(kept));
    arena_.cell.pop();
    extended_cell_.pop_back();
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
    reach(~code, points);
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
      reach(static_cast<int>(leaf), points);
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

// Rows and law of the region, and the cell, in extended precision.
void EvaluatorDescent::load_extended() {
  if (extended_loaded_) return;
  extended_loaded_ = true;
  CertifiedRegion solved;
  certifier_.solve(region_->independent, solved);
  const ExtendedMatrix& forms = certifier_.forms();
  const std::size_t np = index(np_);
  const long double sign = mirrored_half_ ? -1.0L : 1.0L;
  // Every condition, not the facets alone: what leaving one out adds may reach far in a corner.
  extended_.facets.clear();
  for (Eigen::Index row = 0; row < forms.rows(); ++row) {
    ExtendedForm form{};
    long double norm = 0.0L;
    long double reach = 0.0L;
    for (std::size_t c = 0; c <= np; ++c) {
      form[c] = forms(row, static_cast<Eigen::Index>(c)) * (c < np ? sign : 1.0L);
      if (c == np) continue;
      norm += form[c] * form[c];
      reach += std::abs(form[c]);
    }
    if (form[np] >= reach) continue;  // nowhere in the box less than 0
    norm = std::sqrt(norm);
    if (norm <= 1e-15L * std::abs(form[np])) continue;
    for (long double& c : form) c /= norm;
    extended_.facets.push_back(form);
  }
  for (std::size_t c = 0; c <= np; ++c) {
    extended_output_[c] = certifier_.output()[c] * (c < np ? 1.0L : sign);
  }
  if (mirrored_half_) extended_output_[np] += 1.0L;
}

bool EvaluatorDescent::leaf_is_right(int leaf, double tolerance) {
  if (LeafProof<DoubleArena>(tables_, law_.pieces, arena_)
          .prove(leaf, output_, output_low_, output_high_, tolerance)) {
    return true;
  }
  ++result_.decided_again;
  load_extended();
  extended_.cell = extended_cell_;
  return LeafProof<ExtendedArena>(tables_, law_.extended_pieces, extended_)
      .prove(leaf, extended_output_, output_low_, output_high_, tolerance);
}

void EvaluatorDescent::reach(int leaf, const std::vector<Point>& points) {
  ++result_.cells;
  if (quick_used_ && quick_.prove(leaf, points)) {
    result_.error = std::max(result_.error, tolerance_);
    return;
  }
  double error = tolerance_;
  while (error < 1.0 && !leaf_is_right(leaf, error)) error *= 10.0;
  error = std::min(error, 1.0);
  if (error > tolerance_) {
    const double radius = LeafProof<DoubleArena>(tables_, law_.pieces, arena_)
                              .wrong_radius(leaf, output_, output_low_, output_high_, tolerance_);
    if (radius <= kSliver && error <= kSliverError) {
      ++result_.slivers;
      result_.sliver_error = std::max(result_.sliver_error, error);
      result_.sliver_radius = std::max(result_.sliver_radius, radius);
      return;
    }
    ++result_.wrong_cells;
    if (result_.wrong_leaf < 0) result_.wrong_leaf = leaf;
  }
  result_.error = std::max(result_.error, error);
}

void EvaluatorDescent::start(const HalfSpaces& facets, const AffineForm& output) {
  facets_ = &facets;
  arena_.facets = facets_;
  output_ = output;
  std::vector<Point> points;
  AffineForm axis{};
  for (int j = 0; j < np_; ++j) {
    for (const double sign : {1.0, -1.0}) {
      axis[index(j)] = sign;
      const HalfSpaces* parts[] = {facets_, &arena_.cell};
      const LpResult edge = arena_.program.maximise(axis.data(), parts);
      if (edge.status == LpStatus::kInfeasible) return;  // nothing of it on this side of the fold
      const bool known = edge.status == LpStatus::kOptimal;
      (sign > 0.0 ? upper_ : lower_)[index(j)] =
          known ? std::clamp(sign * edge.value, -1.0, 1.0) : sign;
      if (known) {
        Point q{};
        std::copy_n(arena_.program.point(), np_, q.begin());
        points.push_back(q);
      }
    }
    axis[index(j)] = 0.0;
  }
  output_high_ = support(output_);
  output_low_ = -support(negative(output_));
  quick_.start(output_, output_low_, output_high_, lower_, upper_, points);
  if (tables_.flat) {
    enter_flat(0, 0, std::move(points));
  } else {
    enter_tree(tables_.root, std::move(points));
  }
}

EvaluatorDescent::Result EvaluatorDescent::check(const CertifiedRegion& region) {
  result_ = Result{};
  arena_.cell.clear();
  extended_cell_.clear();
  region_ = &region;
  mirrored_half_ = false;
  extended_loaded_ = false;
  const HalfSpaces& facets = region.polytope.facets;
  if (!law_.folded) {
    start(facets, region.output);
    return result_;
  }
  Point side{};
  for (int j = 0; j < np_; ++j) side[index(j)] = -law_.fold[index(j)];
  arena_.cell.append(side.data(), 0.0);
  ExtendedForm half{};
  for (int j = 0; j < np_; ++j) half[index(j)] = law_.fold[index(j)];
  extended_cell_.push_back(half);
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
  mirrored_half_ = true;
  extended_loaded_ = false;
  start(mirrored_, output);
  return result_;
}

}  // namespace eampc::law_design
