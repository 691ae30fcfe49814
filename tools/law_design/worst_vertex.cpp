#include "law_design/worst_vertex.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <vector>

namespace eampc::law_design {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Signs are settled in the order of the rows: depth k settles sign k.
class Search {
 public:
  Search(const VectorXd& linear, const MatrixXd& quadratic)
      : size_(linear.size()),
        coupling_(2.0 * quadratic),
        slopes_(size_ + 1, size_),
        open_coupling_(VectorXd::Zero(size_ + 1)),
        row_coupling_(VectorXd::Zero(size_)),
        signs_(VectorXd::Ones(size_)) {
    slopes_.row(0) = linear;
    for (Index k = size_ - 1; k >= 0; --k) {
      row_coupling_(k) = coupling_.row(k).tail(size_ - 1 - k).cwiseAbs().sum();
      open_coupling_(k) = open_coupling_(k + 1) + row_coupling_(k);
    }
    best_.signs = signs_;
    best_.value = -std::numeric_limits<double>::infinity();
  }

  WorstVertex run(double diagonal) {
    descend(0, diagonal);
    return best_;
  }

 private:
  // `value`: the terms between settled signs, and the diagonal.
  void descend(Index k, double value) {
    ++best_.nodes;
    const auto open = slopes_.row(k).tail(size_ - k);
    if (value + open.cwiseAbs().sum() + open_coupling_(k) <= best_.value) return;
    if (k == size_) {
      best_.value = value;
      best_.signs = signs_;
      return;
    }
    const double slope = slopes_(k, k);
    const double first = slope < 0.0 ? -1.0 : 1.0;
    settle(k, first, value);
    if (std::abs(slope) <= row_coupling_(k)) settle(k, -first, value);
  }

  void settle(Index k, double sign, double value) {
    signs_(k) = sign;
    const Index rest = size_ - 1 - k;
    slopes_.row(k + 1).tail(rest) = slopes_.row(k).tail(rest) + sign * coupling_.row(k).tail(rest);
    descend(k + 1, value + sign * slopes_(k, k));
  }

  Index size_;
  MatrixXd coupling_;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> slopes_;  // by depth
  VectorXd open_coupling_;  // Σ_{k≤i<j} |coupling_ij|
  VectorXd row_coupling_;   // Σ_{j>k} |coupling_kj|
  VectorXd signs_;
  WorstVertex best_;
};

}  // namespace

WorstVertex worst_vertex(const VectorXd& linear, const MatrixXd& quadratic) {
  const Index size = linear.size();
  if (quadratic.rows() != size || quadratic.cols() != size) {
    throw std::invalid_argument("quadratic must have one row and one column per entry of linear");
  }
  // The strongest couplings first: what is left open then promises little.
  std::vector<Index> order(static_cast<std::size_t>(size));
  std::iota(order.begin(), order.end(), Index{0});
  const VectorXd strength = quadratic.cwiseAbs().rowwise().sum();
  std::stable_sort(order.begin(), order.end(),
                   [&](Index i, Index j) { return strength(i) > strength(j); });
  WorstVertex found =
      Search(linear(order), quadratic(order, order)).run(quadratic.diagonal().sum());
  VectorXd signs(size);
  signs(order) = found.signs;
  found.signs = signs;
  return found;
}

}  // namespace eampc::law_design
