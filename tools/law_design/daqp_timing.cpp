#include "law_design/daqp_timing.hpp"

#include <dlfcn.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <limits>
#include <memory>
#include <stdexcept>

namespace eampc::law_design {
namespace {

using Clock = std::chrono::steady_clock;

// DAQP's interface as of 0.11 (include/types.h, api.h, constants.h).
struct DaqpProblem {
  int n, m, ms;
  double *H, *f, *A, *bupper, *blower;
  int* sense;
  int* break_points;
  int nh;
  int problem_type;
};
struct DaqpResult {
  double *x, *lam;
  double fval, soft_slack;
  int exitflag, iter, nodes;
  double solve_time, setup_time;
};
constexpr double kDaqpInfinity = 1e30;
constexpr int kUpdateLinear = 4;
constexpr int kUpdateBounds = 8;
// A DAQPWorkspace is some 500 bytes; it begins as zeros.
constexpr std::size_t kWorkspaceBytes = 8192;

class Library {
 public:
  explicit Library(const std::string& path) : handle_(dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    if (handle_ == nullptr) {
      throw std::runtime_error(path + ": cannot be loaded");
    }
    find(allocate_settings, "allocate_daqp_settings");
    find(setup, "setup_daqp");
    find(update, "daqp_update_ldp");
    find(deactivate, "daqp_deactivate_constraints");
    find(solve, "daqp_solve");
    find(free_workspace, "free_daqp_workspace");
    find(free_ldp, "free_daqp_ldp");
  }
  ~Library() { dlclose(handle_); }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  void (*allocate_settings)(void*) = nullptr;
  int (*setup)(DaqpProblem*, void*, double*) = nullptr;
  int (*update)(int, void*, DaqpProblem*) = nullptr;
  void (*deactivate)(void*) = nullptr;
  void (*solve)(DaqpResult*, void*) = nullptr;
  void (*free_workspace)(void*) = nullptr;
  void (*free_ldp)(void*) = nullptr;

 private:
  template <typename F>
  void find(F*& function, const char* name) {
    function = reinterpret_cast<F*>(dlsym(handle_, name));
    if (function == nullptr) {
      throw std::runtime_error(std::string("the DAQP library lacks ") + name +
                               "; install the version in tools/requirements.txt");
    }
  }

  void* handle_;
};

class PreparedDaqp {
 public:
  PreparedDaqp(const std::string& path, BoundedProgram program)
      : library_(path), program_(std::move(program)), workspace_(kWorkspaceBytes) {
    const auto n = program_.H.rows();
    const auto m = program_.upper_offset.size();
    f_.resize(n);
    upper_.resize(m);
    lower_.resize(m);
    x_.resize(n);
    multipliers_.resize(m);
    problem_ = {static_cast<int>(n),
                static_cast<int>(m),
                static_cast<int>(m - program_.A.rows()),
                program_.H.data(),
                f_.data(),
                program_.A.data(),
                upper_.data(),
                lower_.data(),
                nullptr,
                nullptr,
                0,
                0};
    result_.x = x_.data();
    result_.lam = multipliers_.data();
    set_parameter(Eigen::VectorXd::Zero(program_.F.cols()));
    library_.allocate_settings(workspace_.data());
    if (library_.setup(&problem_, workspace_.data(), nullptr) < 0) {
      throw std::runtime_error("DAQP refuses the problem");
    }
  }
  ~PreparedDaqp() {
    library_.free_workspace(workspace_.data());
    library_.free_ldp(workspace_.data());
  }
  PreparedDaqp(const PreparedDaqp&) = delete;
  PreparedDaqp& operator=(const PreparedDaqp&) = delete;

  double solve_ns(const Eigen::VectorXd& p, bool warm) {
    if (!warm) library_.deactivate(workspace_.data());
    const Clock::time_point begin = Clock::now();
    set_parameter(p);
    const int flag = library_.update(kUpdateLinear | kUpdateBounds, workspace_.data(), &problem_);
    result_.exitflag = flag;
    if (flag >= 0) library_.solve(&result_, workspace_.data());
    const Clock::time_point end = Clock::now();
    // What an infeasible point leaves behind is no start for the next one.
    if (result_.exitflag < 0) library_.deactivate(workspace_.data());
    return std::chrono::duration<double, std::nano>(end - begin).count();
  }

  const Eigen::VectorXd& x() const { return x_; }
  const DaqpResult& result() const { return result_; }

 private:
  void set_parameter(const Eigen::VectorXd& p) {
    f_.noalias() = program_.F * p;
    f_ += program_.f;
    upper_.noalias() = program_.upper_gain * p;
    upper_ += program_.upper_offset;
    lower_.noalias() = program_.lower_gain * p;
    lower_ += program_.lower_offset;
  }

  Library library_;
  BoundedProgram program_;
  std::vector<std::byte> workspace_;
  Eigen::VectorXd f_, upper_, lower_, x_, multipliers_;
  DaqpProblem problem_{};
  DaqpResult result_{};
};

}  // namespace

DaqpTiming time_daqp(const std::string& library, BoundedProgram program, const RowMatrix& points,
                     bool warm, int repetitions) {
  for (Eigen::VectorXd* bound : {&program.lower_offset, &program.upper_offset}) {
    *bound = bound->cwiseMax(-kDaqpInfinity).cwiseMin(kDaqpInfinity);
  }
  const Eigen::Index count = points.rows();
  DaqpTiming timing;
  timing.U.resize(count, program.H.rows());
  timing.point_ns.assign(static_cast<std::size_t>(count), std::numeric_limits<double>::infinity());
  timing.exit_flags.resize(static_cast<std::size_t>(count));
  timing.iterations.resize(static_cast<std::size_t>(count));
  PreparedDaqp daqp(library, std::move(program));
  Eigen::VectorXd p;
  for (int repetition = 0; repetition < repetitions; ++repetition) {
    for (Eigen::Index k = 0; k < count; ++k) {
      const auto at = static_cast<std::size_t>(k);
      p = points.row(k);
      timing.point_ns[at] = std::min(timing.point_ns[at], daqp.solve_ns(p, warm));
      timing.exit_flags[at] = daqp.result().exitflag;
      timing.iterations[at] = daqp.result().iter;
      timing.U.row(k) = daqp.x();
    }
  }
  return timing;
}

}  // namespace eampc::law_design
