// Linear program in extended precision, for the few questions that doubles cannot decide: in a
// corner between two nearly parallel rows, a tolerance of 1e-11 on the rows is a step of 1e-4.
#pragma once

#include <array>
#include <vector>

#include "law_design/polytope.hpp"

namespace eampc::law_design {

/// c[0..np)·q + c[np].
using ExtendedForm = std::array<long double, kMaxDimension + 1>;

class ExtendedProgram {
 public:
  /// Distance by which a row may be violated.
  static constexpr long double kTolerance = 1e-17L;

  explicit ExtendedProgram(int dimension) : dimension_(dimension) {}

  /// True if proved: no q in the box [-1, 1]^n with form·(q, 1) ≥ 0 for all `rows` (unit) has
  /// objective·(q, 1) > cutoff. By weak duality: the objective is written as a sum of rows with
  /// multipliers ≥ 0, so the proof does not depend on how its basis was found.
  bool below(const std::vector<const ExtendedForm*>& rows, const ExtendedForm& objective,
             long double cutoff);

 private:
  enum class Outcome {
    kProved,
    kOpen,  ///< a point above the cutoff
    kLost,  ///< in bases that cannot be inverted, or in too many steps
  };
  using Square = std::array<std::array<long double, kMaxDimension>, kMaxDimension>;
  Outcome attempt(const std::vector<const ExtendedForm*>& rows, const ExtendedForm& objective,
                  long double cutoff);
  void load(const std::vector<const ExtendedForm*>& rows, int row, long double* a,
            long double* b) const;
  bool invert(const std::vector<const ExtendedForm*>& rows, Square& inverse) const;

  int dimension_;
  std::array<int, kMaxDimension> basis_{};
};

}  // namespace eampc::law_design
