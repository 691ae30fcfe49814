// Python binding of the timings for `eampc bench law`: an explicit law by the daemon's code, and
// DAQP's C library, both without Python in the time.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <cmath>

#include "law_design/bind_arrays.hpp"
#include "law_design/daqp_timing.hpp"
#include "law_design/law_timing.hpp"
#include "law_design/numpy_column.hpp"
#include "service/law_packing.hpp"
#include "service/law_tables.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

std::span<const double> rows_of(const char* name, const Matrix& points, int n_parameters) {
  if (points.shape(1) != static_cast<std::size_t>(n_parameters)) {
    throw nb::value_error(
        (std::string(name) + " must have one column for each parameter of the law").c_str());
  }
  return {points.data(), points.size()};
}

nb::dict law_timing(const service::LawTables& tables, const Matrix& points, const Matrix& fresh,
                    double u_min, double u_max, const std::string& path, int sweeps,
                    int repetitions, int cold_points, int cold_repetitions) {
  if (!(u_min <= u_max) || sweeps < 1 || repetitions < 1 || cold_repetitions < 0 ||
      points.shape(0) < 1) {
    throw nb::value_error(
        "u_min must not exceed u_max, sweeps, repetitions and points be at least 1");
  }
  const auto known = rows_of("points", points, tables.n_parameters);
  const auto new_points = rows_of("fresh", fresh, tables.n_parameters);
  const service::LawPacking packing(tables, service::evaluation_path(path));
  LawTiming timing;
  {
    const nb::gil_scoped_release released;
    timing = time_law(packing.law(), known, new_points,
                      {u_min, u_max, sweeps, repetitions, cold_points, cold_repetitions});
  }
  nb::dict out;
  out["timer_ns"] = timing.timer_ns;
  out["sweep_ns"] = timing.sweep_ns;
  out["fresh_ns"] = timing.fresh_ns;
  out["chain_ns"] = timing.chain_ns;
  out["point_ns"] = numpy_column(std::move(timing.point_ns));
  out["cold_ns"] = numpy_column(std::move(timing.cold_ns));
  out["bytes"] = packing.bytes();
  return out;
}

nb::dict daqp_timing(const std::string& library, const RowMatrix& H, const RowMatrix& F,
                     const Eigen::VectorXd& f, const RowMatrix& A, const RowMatrix& lower_gain,
                     const Eigen::VectorXd& lower_offset, const RowMatrix& upper_gain,
                     const Eigen::VectorXd& upper_offset, const RowMatrix& points, bool warm,
                     int repetitions) {
  const auto n = H.rows();
  const auto m = upper_offset.size();
  const auto np = F.cols();
  if (H.cols() != n || F.rows() != n || f.size() != n || A.cols() != n || m < A.rows() ||
      lower_offset.size() != m || lower_gain.rows() != m || upper_gain.rows() != m ||
      lower_gain.cols() != np || upper_gain.cols() != np || points.cols() != np ||
      repetitions < 1) {
    throw nb::value_error("the arrays do not make one program with its points");
  }
  DaqpTiming timing;
  {
    const nb::gil_scoped_release released;
    timing = time_daqp(library, {H, F, f, A, lower_gain, upper_gain, lower_offset, upper_offset},
                       points, warm, repetitions);
  }
  nb::dict out;
  out["point_ns"] = numpy_column(std::move(timing.point_ns));
  out["exit_flags"] = numpy_column(std::move(timing.exit_flags));
  out["iterations"] = numpy_column(std::move(timing.iterations));
  out["U"] = nb::cast(timing.U);
  return out;
}

// Which of the evaluation's paths this processor runs: the one that "best" stands for.
const char* best_path() {
  using control::EvaluationPath;
  const auto function = [](EvaluationPath path) { return control::evaluation(5, {}, path); };
  const auto best = function(EvaluationPath::kBest);
  return best == function(EvaluationPath::kAvx512)      ? "avx512"
         : best == function(EvaluationPath::kAvx2)      ? "avx2"
         : best == function(EvaluationPath::kVector128) ? "vector128"
                                                        : "scalar";
}

nb::dict build_information() {
  nb::dict out;
#ifdef __clang__
  out["compiler"] = std::string("clang ") + __clang_version__;
#else
  out["compiler"] = std::string("gcc ") + __VERSION__;
#endif
  std::string flags = EAMPC_COMPILER_FLAGS;
  flags.erase(0, flags.find_first_not_of(' '));
  out["flags"] = flags;
  out["path"] = best_path();
  return out;
}

}  // namespace

void bind_timing(nb::module_& m) {
  m.def("build_information", &build_information,
        "What this module was compiled with, and the evaluation path that this processor runs: "
        "compiler, flags, path.");
  m.def("time_law", &law_timing, "tables"_a, "points"_a, "fresh"_a, "u_min"_a, "u_max"_a,
        "path"_a = "best", "sweeps"_a = 15, "repetitions"_a = 41, "cold_points"_a = 512,
        "cold_repetitions"_a = 5,
        "Nanoseconds per evaluation of a law, clip included: dict.\n\n"
        "points (k, np): sweep_ns (median of whole sweeps), chain_ns (each waits for the value "
        "before), point_ns (k,) and\n"
        "cold_ns (least per single point, timer included; cold: after 4 MiB of other memory were "
        "written). fresh (j, np):\n"
        "fresh_ns, each used once. timer_ns: the clock alone. bytes: of the tables as they run.");
  m.def("time_daqp", &daqp_timing, "library"_a, "H"_a, "F"_a, "f"_a, "A"_a, "lower_gain"_a,
        "lower_offset"_a, "upper_gain"_a, "upper_offset"_a, "points"_a, "warm"_a,
        "repetitions"_a = 3,
        "DAQP's C library on min UᵀHU/2 + (F p + f)ᵀU, lower_gain p + lower_offset ≤ (U; A U) ≤ "
        "upper_gain p +\n"
        "upper_offset, for the rows of points: dict of point_ns, exit_flags, iterations, U.\n\n"
        "library: path of the wheel's extension module. Timed: linear term and bounds from p, "
        "daqp_update_ldp for them,\n"
        "daqp_solve. warm: each point starts from the working set of the one before. RuntimeError "
        "if the library cannot be used.");
}

}  // namespace eampc::law_design
