// A leaf of the evaluator against the law of one region on a polytope P: see
// evaluator_certificate.hpp for the two questions asked. `Arena` answers them: it holds P and rows
// added to it, in doubles (arithmetic as fast as the design's) or in extended precision.
//   Form                         np + 1 coefficients
//   int size(), void cut(int)    rows added so far; drops those beyond
//   void add(Form)               a row form·(q, 1) ≥ 0 of unit normal
//   bool below(Form, real)       proved: no point of P and the rows has form·(q, 1) above it
//   double radius(Form, real)    of the largest ball of such points; for wrong_radius() only
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/law_tables.hpp"

namespace eampc::law_design {

template <typename Arena>
class LeafProof {
 public:
  using Form = typename Arena::Form;
  using Real = typename Form::value_type;

  LeafProof(const service::LawTables& tables, const std::vector<Form>& pieces, Arena& arena)
      : tables_(tables),
        pieces_(pieces),
        arena_(arena),
        np_(static_cast<std::size_t>(tables.n_parameters)) {}

  /// Radius of the largest ball, over all ways to be wrong, of points of P that are.
  double wrong_radius(int leaf, const Form& own, Real low, Real high, Real tolerance) {
    collecting_ = true;
    wrong_radius_ = 0.0;
    prove(leaf, own, low, high, tolerance);
    collecting_ = false;
    return wrong_radius_;
  }

  /// True if proved. The law `own` lies between `low` and `high` on P.
  bool prove(int leaf, const Form& own, Real low, Real high, Real tolerance) {
    if (low < 1 - tolerance) {
      for (int term = tables_.leaf_first[at(leaf)]; term < tables_.leaf_first[at(leaf + 1)];
           ++term) {
        if (!not_too_high(term, own, tolerance)) return false;
      }
    }
    return not_too_low(leaf, own, high, tolerance);
  }

  bool not_too_high(int term, const Form& own, Real tolerance) {
    own_ = own;
    return !too_high(term, tolerance);
  }

  bool not_too_low(int leaf, const Form& own, Real high, Real tolerance) {
    if (high <= tolerance) return true;
    own_ = own;
    std::vector<int> terms;
    for (int term = tables_.leaf_first[at(leaf)]; term < tables_.leaf_first[at(leaf + 1)]; ++term) {
      bool same = true;
      for (int i = begin(term); i < begin(term + 1); ++i) same = same && is_own(i, tolerance);
      if (same) return true;
      terms.push_back(term);
    }
    arena_.cut(0);
    if (!require(shifted(own_, -tolerance))) return true;
    // A term of several pieces that nowhere falls below says it alone.
    for (std::size_t t = 0; !collecting_ && terms.size() > 1 && t < terms.size(); ++t) {
      if (begin(terms[t] + 1) - begin(terms[t]) < 2) continue;
      if (!too_low({terms[t]}, 0, tolerance)) return true;
    }
    return !too_low(terms, 0, tolerance);
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  int begin(int term) const { return tables_.term_first[at(term)]; }
  const Form& piece(int i) const { return pieces_[at(tables_.term_pieces[at(i)])]; }

  Form difference(const Form& a, const Form& b) const {
    Form result{};
    for (std::size_t c = 0; c <= np_; ++c) result[c] = a[c] - b[c];
    return result;
  }
  Form shifted(Form form, Real constant) const {
    form[np_] += constant;
    return form;
  }
  Form constant(Real value) const { return shifted(Form{}, value); }

  bool is_own(int i, Real tolerance) const {
    Real sum = 0;
    for (const Form d = difference(piece(i), own_); const Real c : d) sum += std::abs(c);
    return sum <= tolerance;
  }

  /// Adds form·(q, 1) ≥ 0; false if no point of the box satisfies it.
  bool require(Form form) {
    Real norm = 0;
    Real reach = form[np_];
    for (std::size_t j = 0; j < np_; ++j) {
      norm += form[j] * form[j];
      reach += std::abs(form[j]);
    }
    if (reach < 0) return false;
    norm = std::sqrt(norm);
    if (norm < static_cast<Real>(1e-14)) return true;  // true on the whole box, to rounding
    for (Real& c : form) c /= norm;
    arena_.add(form);
    return true;
  }

  /// A point where every piece of the term exceeds the clipped law may exist.
  bool too_high(int term, Real tolerance) {
    for (int i = begin(term); i < begin(term + 1); ++i) {
      if (is_own(i, tolerance)) return false;
    }
    arena_.cut(0);
    if (!require(difference(constant(1 - tolerance), own_))) return false;
    for (int i = begin(term); i < begin(term + 1); ++i) {
      if (!require(shifted(piece(i), -tolerance))) return false;
      if (i > begin(term) && !require(shifted(difference(piece(i), own_), -tolerance))) {
        return false;
      }
    }
    const Form excess = difference(piece(begin(term)), own_);
    return !arena_.below(excess, tolerance) && wrong(excess, tolerance);
  }

  /// A point where every term from `from` on has a piece below the clipped law may exist.
  bool too_low(const std::vector<int>& terms, std::size_t from, Real tolerance) {
    const int term = terms[from];
    for (int i = begin(term); i < begin(term + 1); ++i) {
      const int rows = arena_.size();
      bool possible = require(difference(constant(1 - tolerance), piece(i)));
      if (possible) {
        const Form gap = difference(own_, piece(i));
        possible = !arena_.below(gap, tolerance);
        if (possible) {
          possible = from + 1 < terms.size()
                         ? require(shifted(gap, -tolerance)) && too_low(terms, from + 1, tolerance)
                         : wrong(gap, tolerance);
        }
      }
      arena_.cut(rows);
      if (possible) return true;
    }
    return false;
  }

  /// True: that is the answer. False: measured, go on.
  bool wrong(const Form& form, Real tolerance) {
    if constexpr (requires { arena_.radius(form, tolerance); }) {
      if (collecting_) {
        wrong_radius_ = std::max(wrong_radius_, arena_.radius(form, tolerance));
        return false;
      }
    }
    return true;
  }

  const service::LawTables& tables_;
  const std::vector<Form>& pieces_;
  Arena& arena_;
  std::size_t np_;
  Form own_{};
  bool collecting_ = false;
  double wrong_radius_ = 0.0;
};

}  // namespace eampc::law_design
