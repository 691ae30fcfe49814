#include "law_design/worst_vertex.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace eampc::law_design {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd vertex(Index size, unsigned bits) {
  VectorXd signs(size);
  for (Index i = 0; i < size; ++i) signs(i) = (bits >> static_cast<unsigned>(i)) & 1u ? 1.0 : -1.0;
  return signs;
}

double value_at(const VectorXd& linear, const MatrixXd& quadratic, const VectorXd& signs) {
  return linear.dot(signs) + signs.dot(quadratic * signs);
}

double largest_of_all(const VectorXd& linear, const MatrixXd& quadratic) {
  double largest = -std::numeric_limits<double>::infinity();
  for (unsigned bits = 0; bits < 1u << linear.size(); ++bits) {
    largest = std::max(largest, value_at(linear, quadratic, vertex(linear.size(), bits)));
  }
  return largest;
}

struct Numbers {
  std::mt19937_64 random{17};
  std::normal_distribution<double> normal;

  VectorXd vector(Index n) {
    return VectorXd::NullaryExpr(n, [&] { return normal(random); });
  }
  MatrixXd matrix(Index n) {
    return MatrixXd::NullaryExpr(n, n, [&] { return normal(random); });
  }
};

void expect_largest(const VectorXd& linear, const MatrixXd& quadratic) {
  const WorstVertex worst = worst_vertex(linear, quadratic);
  const double largest = largest_of_all(linear, quadratic);
  const double scale = 1.0 + std::abs(largest);
  ASSERT_NEAR(worst.value, largest, 1e-12 * scale);
  ASSERT_NEAR(value_at(linear, quadratic, worst.signs), largest, 1e-12 * scale);
  ASSERT_TRUE((worst.signs.array().abs() == 1.0).all());
}

TEST(WorstVertex, IsTheLargestOfAllVertices) {
  Numbers numbers;
  for (Index n = 1; n <= 12; ++n) {
    for (int trial = 0; trial < 20; ++trial) {
      const MatrixXd any = numbers.matrix(n);
      const double weight = std::pow(10.0, trial % 4 - 2);  // linear or quadratic part in charge
      const VectorXd linear = weight * numbers.vector(n);
      expect_largest(linear, any * any.transpose());
      expect_largest(linear, 0.5 * (any + any.transpose()));
    }
  }
}

// Responses of one sign, as those of an angle to a torque: what min-max MPC asks.
TEST(WorstVertex, SearchesLittleWhereAllCouplingsHaveOneSign) {
  constexpr Index kStages = 20;
  MatrixXd response = MatrixXd::Zero(kStages, kStages);
  for (Index i = 0; i < kStages; ++i) {
    for (Index j = 0; j <= i; ++j) response(i, j) = static_cast<double>(i - j) + 0.5;
  }
  const MatrixXd quadratic = response.transpose() * response;
  Numbers numbers;
  for (int trial = 0; trial < 200; ++trial) {
    const VectorXd error = 100.0 * numbers.vector(kStages);
    const WorstVertex worst = worst_vertex(2.0 * response.transpose() * error, quadratic);
    EXPECT_LT(worst.nodes, 20'000);
  }
}

TEST(WorstVertex, NothingToChooseIsNoError) {
  const WorstVertex worst = worst_vertex(VectorXd(), MatrixXd());
  EXPECT_EQ(worst.signs.size(), 0);
  EXPECT_EQ(worst.value, 0.0);
}

TEST(WorstVertex, RefusesShapesThatDoNotFit) {
  EXPECT_THROW(worst_vertex(VectorXd::Zero(3), MatrixXd::Zero(3, 2)), std::invalid_argument);
}

}  // namespace
}  // namespace eampc::law_design
