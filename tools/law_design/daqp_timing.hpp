// How long DAQP takes for a multiparametric program at given parameters, called as its C library
// from here, so that no Python is in the time. The library is the one inside the PyPI wheel `daqp`
// (its extension module exports DAQP's C functions). In: the program, points → out: nanoseconds per
// point, solutions.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

namespace eampc::law_design {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// min ½ UᵀHU + (F p + f)ᵀU subject to lower_offset + lower_gain p ≤ (U; A U) ≤ upper_…; the first
// rows bound U itself. An infinite bound is none.
struct BoundedProgram {
  RowMatrix H;
  RowMatrix F;
  Eigen::VectorXd f;
  RowMatrix A;
  RowMatrix lower_gain, upper_gain;
  Eigen::VectorXd lower_offset, upper_offset;
};

struct DaqpTiming {
  std::vector<double> point_ns;  // least of the repetitions, timer included
  RowMatrix U;                   // rows: solutions
  std::vector<std::int32_t> exit_flags;
  std::vector<std::int32_t> iterations;
};

// Everything that does not depend on p is prepared before (factors of H, A in its coordinates).
// Timed per point: F p + f and the bounds, daqp_update_ldp for both, daqp_solve. Cold: the working
// set is emptied before each point, outside of the time. Warm: the points follow one another with
// the working set of the one before. Throws std::runtime_error if the library cannot be used.
DaqpTiming time_daqp(const std::string& library, BoundedProgram program, const RowMatrix& points,
                     bool warm, int repetitions);

}  // namespace eampc::law_design
