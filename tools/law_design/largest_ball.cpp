#include "law_design/largest_ball.hpp"

#include <algorithm>
#include <array>
#include <cstddef>

#include "law_design/polytope.hpp"

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

LargestBall::LargestBall(int dimension)
    : dimension_(dimension), program_(dimension + 1), rows_(dimension + 1), box_(dimension + 1) {
  program_.set_bounds(dimension, -4.0, 2.0);
  std::array<double, kMaxDimension + 1> a{};
  a[index(dimension)] = 1.0;
  for (int side = 0; side < 2 * dimension; ++side) {
    a[index(side / 2)] = side % 2 == 0 ? 1.0 : -1.0;
    box_.append(a.data(), 1.0);
    a[index(side / 2)] = 0.0;
  }
}

void LargestBall::append(const double* a, double b) {
  std::array<double, kMaxDimension + 1> lifted{};
  std::copy_n(a, dimension_, lifted.begin());
  lifted[index(dimension_)] = 1.0;
  rows_.append(lifted.data(), b);
}

LpResult LargestBall::find(double cutoff) {
  std::array<double, kMaxDimension + 1> radius{};
  radius[index(dimension_)] = 1.0;
  const HalfSpaces* parts[] = {&rows_, &box_};
  return program_.maximise(radius.data(), parts, cutoff);
}

}  // namespace eampc::law_design
