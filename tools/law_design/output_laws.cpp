#include "law_design/output_laws.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>

#include "law_design/linear_program.hpp"

namespace eampc::law_design {
namespace {

// Of the output's range, which is 1 here.
constexpr double kSameLaw = 1e-9;
constexpr double kSaturated = 1e-9;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

ScaledLaw scaled_law(const CriticalRegion& region, const OutputLaw& output,
                     const OutputLaws& laws) {
  const double range = output.y_max - output.y_min;
  const Eigen::RowVectorXd slope = output.Y_U * region.gain + output.Y_p;
  const double offset = output.Y_U.dot(region.offset) + output.y_0;
  ScaledLaw law{};
  double middle = offset;
  for (int j = 0; j < laws.parameters; ++j) {
    law[index(j)] = slope(j) * laws.half_width(j) / range;
    middle += slope(j) * laws.centre(j);
  }
  law[kMaxDimension] = (middle - output.y_min) / range;
  return law;
}

double difference(const ScaledLaw& a, const ScaledLaw& b) {
  double sum = 0.0;
  for (std::size_t j = 0; j < a.size(); ++j) sum += std::abs(a[j] - b[j]);
  return sum;
}

// Groups laws that agree over the whole box; returns the group of each.
std::vector<int> group(const std::vector<ScaledLaw>& all, std::vector<ScaledLaw>& distinct) {
  std::vector<int> order(all.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return all[index(a)] != all[index(b)]
               ? all[index(a)][kMaxDimension] < all[index(b)][kMaxDimension] ||
                     (all[index(a)][kMaxDimension] == all[index(b)][kMaxDimension] &&
                      all[index(a)] < all[index(b)])
               : a < b;
  });
  std::vector<int> groups(all.size(), -1);
  std::vector<int> representatives;  // members of `order`, ascending offset
  for (const int i : order) {
    for (auto r = representatives.rbegin(); r != representatives.rend(); ++r) {
      const ScaledLaw& other = all[index(*r)];
      if (all[index(i)][kMaxDimension] - other[kMaxDimension] > kSameLaw) break;
      if (difference(all[index(i)], other) <= kSameLaw) {
        groups[index(i)] = groups[index(*r)];
        break;
      }
    }
    if (groups[index(i)] < 0) {
      groups[index(i)] = static_cast<int>(distinct.size());
      distinct.push_back(all[index(i)]);
      representatives.push_back(i);
    }
  }
  return groups;
}

enum class Saturation { kNone, kLow, kHigh };

Saturation saturation(const ScaledLaw& law, const HalfSpaces& facets, LinearProgram& program) {
  const double y_0 = law[kMaxDimension];
  Point c{};
  std::copy(law.begin(), law.begin() + kMaxDimension, c.begin());
  const auto below = [&](double bound) {
    double reach = 0.0;
    for (const double slope : c) reach += std::abs(slope);
    if (reach <= bound) return true;
    const LpResult result = program.maximise(c.data(), facets, bound);
    return result.status == LpStatus::kBelowCutoff ||
           (result.status == LpStatus::kOptimal && result.value <= bound);
  };
  if (below(kSaturated - y_0)) return Saturation::kLow;
  for (double& slope : c) slope = -slope;
  if (below(y_0 - 1.0 + kSaturated)) return Saturation::kHigh;
  return Saturation::kNone;
}

}  // namespace

OutputLaws distinct_output_laws(const MpQpSolution& solution, const OutputLaw& output) {
  OutputLaws result;
  const Eigen::Index np = solution.lower.size();
  if (solution.regions.empty()) throw std::invalid_argument("search tree: no critical region");
  if (output.Y_U.size() != solution.regions.front().offset.size() || output.Y_p.size() != np) {
    throw std::invalid_argument("search tree: Y_U needs n entries and Y_p needs np");
  }
  if (!(output.y_min < output.y_max) || !std::isfinite(output.y_max - output.y_min)) {
    throw std::invalid_argument("search tree: y_min and y_max must be finite, y_min < y_max");
  }
  result.parameters = static_cast<int>(np);
  result.centre = 0.5 * (solution.lower + solution.upper);
  result.half_width = 0.5 * (solution.upper - solution.lower);

  LinearProgram program(result.parameters);
  std::vector<int> kept(solution.regions.size(), -1);  // index in result.regions
  std::vector<ScaledLaw> all;
  std::vector<std::size_t> source;
  for (std::size_t r = 0; r < solution.regions.size(); ++r) {
    const CriticalRegion& region = solution.regions[r];
    const ScaledLaw law = scaled_law(region, output, result);
    LawRegion scaled;
    scaled.facets = HalfSpaces(result.parameters);
    scaled.ball_facets = HalfSpaces(result.parameters + 1);
    for (Eigen::Index i = 0; i < region.facet_normals.rows(); ++i) {
      Eigen::VectorXd a = region.facet_normals.row(i).transpose().cwiseProduct(result.half_width);
      double b = region.facet_offsets(i) - region.facet_normals.row(i).dot(result.centre);
      const double norm = a.norm();
      a /= norm;
      b /= norm;
      scaled.facets.append(a.data(), b);
      std::array<double, kMaxDimension + 1> ball{};
      std::copy(a.data(), a.data() + np, ball.begin());
      ball[static_cast<std::size_t>(np)] = 1.0;
      scaled.ball_facets.append(ball.data(), b);
    }
    switch (saturation(law, scaled.facets, program)) {
      case Saturation::kLow:
        ++result.saturated_low;
        continue;
      case Saturation::kHigh:
        ++result.saturated_high;
        continue;
      case Saturation::kNone:
        break;
    }
    for (int j = 0; j < result.parameters; ++j) {
      scaled.inside[index(j)] = (region.interior(j) - result.centre(j)) / result.half_width(j);
    }
    kept[r] = static_cast<int>(result.regions.size());
    all.push_back(law);
    source.push_back(r);
    result.regions.push_back(std::move(scaled));
  }
  const std::vector<int> groups = group(all, result.laws);
  for (std::size_t k = 0; k < result.regions.size(); ++k) result.regions[k].law = groups[k];
  for (std::size_t k = 0; k < result.regions.size(); ++k) {
    const auto& neighbours = solution.regions[source[k]].neighbours;
    for (std::size_t f = 0; f < neighbours.size(); ++f) {
      bool unsaturated = false;
      bool differs = false;
      for (const int neighbour : neighbours[f]) {
        const int other = kept[index(neighbour)];
        if (other < 0) continue;
        unsaturated = true;
        differs |= groups[index(other)] != groups[k];
      }
      if (differs) result.regions[k].law_facets.push_back(static_cast<int>(f));
      if (!unsaturated) result.regions[k].outer_facets.push_back(static_cast<int>(f));
    }
  }
  return result;
}

}  // namespace eampc::law_design
