// Python binding of the worst vertex of a quadratic on a box.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>

#include "law_design/worst_vertex.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {

void bind_worst_vertex(nb::module_& m) {
  m.def(
      "worst_vertex",
      [](const Eigen::VectorXd& linear, const Eigen::MatrixXd& quadratic) {
        const WorstVertex worst = worst_vertex(linear, quadratic);
        return nb::make_tuple(worst.signs, worst.value, worst.nodes);
      },
      "linear"_a, "quadratic"_a,
      "The signs s, each -1 or 1, at which linear.s + s'quadratic s is largest: (s (n,), value, "
      "nodes searched).\n\n"
      "Exact to rounding, by branch and bound; quadratic (n, n) symmetric. ValueError: shapes do "
      "not fit.");
}

}  // namespace eampc::law_design
