// A cell of the evaluator in doubles: P = facets ∩ cell, and rows added to it.
#pragma once

#include <span>

#include "law_design/half_spaces.hpp"
#include "law_design/linear_program.hpp"
#include "law_design/polytope.hpp"
#include "law_design/region_certificate.hpp"

namespace eampc::law_design {

/// See leaf_proof.hpp for what an arena is.
struct DoubleArena {
  using Form = AffineForm;
  explicit DoubleArena(int dimension);
  int size() const { return rows.size(); }
  void cut(int size) {
    while (rows.size() > size) rows.pop();
  }
  void add(const Form& form);
  bool below(const Form& form, double limit);
  double radius(const Form& form, double limit);
  /// False if proved: nowhere in `parts` is form·(q, 1) above the limit. Else perhaps; `point` is
  /// where the search ended.
  bool reaches(const Form& form, double limit, std::span<const HalfSpaces* const> parts,
               Point* point);

  LinearProgram program, ball;
  const HalfSpaces* facets = nullptr;
  HalfSpaces cell, rows;
};

}  // namespace eampc::law_design
