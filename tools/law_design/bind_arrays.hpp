// NumPy arrays and progress callbacks at the border to Python, for every bind_*.cpp that needs
// them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <Eigen/Dense>
#include <cstddef>
#include <exception>
#include <functional>
#include <initializer_list>
#include <utility>
#include <vector>

namespace eampc::law_design {

namespace nb = nanobind;

using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

inline Eigen::MatrixXd matrix(const Matrix& a) {
  return Eigen::Map<const RowMajor>(a.data(), static_cast<Eigen::Index>(a.shape(0)),
                                    static_cast<Eigen::Index>(a.shape(1)));
}

inline Eigen::VectorXd vector(const Vector& a) {
  return Eigen::Map<const Eigen::VectorXd>(a.data(), static_cast<Eigen::Index>(a.shape(0)));
}

template <typename T>
nb::ndarray<nb::numpy, T> array(std::vector<T> values, std::initializer_list<std::size_t> shape) {
  auto* owned = new std::vector<T>(std::move(values));
  nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, T>(owned->data(), shape, owner);
}

inline nb::ndarray<nb::numpy, double> array(const Eigen::MatrixXd& a) {
  std::vector<double> values(static_cast<std::size_t>(a.size()));
  Eigen::Map<RowMajor>(values.data(), a.rows(), a.cols()) = a;
  return array(std::move(values),
               {static_cast<std::size_t>(a.rows()), static_cast<std::size_t>(a.cols())});
}

inline nb::ndarray<nb::numpy, double> array(const Eigen::VectorXd& a) {
  return array(std::vector<double>(a.data(), a.data() + a.size()),
               {static_cast<std::size_t>(a.size())});
}

// The solver runs without the GIL; the callback takes it back. An exception in the callback
// cancels and is raised again afterwards.
inline std::function<bool(int, int)> progress_function(const nb::object& progress,
                                                       std::exception_ptr& raised) {
  if (progress.is_none()) return {};
  return [&progress, &raised](int done, int known) {
    nb::gil_scoped_acquire gil;
    try {
      if (PyErr_CheckSignals() != 0) throw nb::python_error();
      const nb::object answer = progress(done, known);
      return answer.is_none() || nb::cast<bool>(answer);
    } catch (...) {
      raised = std::current_exception();
      return false;
    }
  };
}

}  // namespace eampc::law_design
