#include "law_design/law_planes.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <unordered_map>

namespace eampc::law_design {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

}  // namespace

LawPlanes collect_law_planes(const OutputLaws& laws) {
  LawPlanes result;
  std::unordered_map<std::size_t, std::vector<int>> buckets;
  const auto add = [&](const LawRegion& region, int facet) {
    Hyperplane plane;
    region.facets.copy_normal(facet, plane.normal.data());
    plane.offset = region.facets.offset(facet);
    for (int j = 0; j < laws.parameters; ++j) {
      if (std::abs(plane.normal[index(j)]) < 1e-6) continue;
      if (plane.normal[index(j)] < 0.0) {
        for (double& a : plane.normal) a = -a;
        plane.offset = -plane.offset;
      }
      break;
    }
    std::size_t key = 1469598103934665603U;
    const auto mix = [&](double x) {
      key ^= static_cast<std::size_t>(static_cast<std::int64_t>(std::llround(x * 1e7)));
      key *= 1099511628211U;
    };
    for (int j = 0; j < laws.parameters; ++j) mix(plane.normal[index(j)]);
    mix(plane.offset);
    for (const int other : buckets[key]) {
      double difference = std::abs(result.planes[index(other)].offset - plane.offset);
      for (std::size_t j = 0; j < plane.normal.size(); ++j) {
        difference += std::abs(result.planes[index(other)].normal[j] - plane.normal[j]);
      }
      if (difference < 1e-10) return other;
    }
    const int id = static_cast<int>(result.planes.size());
    buckets[key].push_back(id);
    result.planes.push_back(plane);
    return id;
  };
  for (const LawRegion& region : laws.regions) {
    result.law.emplace_back();
    result.outer.emplace_back();
    for (const int f : region.law_facets) result.law.back().push_back(add(region, f));
    for (const int f : region.outer_facets) result.outer.back().push_back(add(region, f));
  }
  return result;
}

SplitNode in_problem_units(const Hyperplane& plane, const OutputLaws& laws) {
  SplitNode node{};
  double norm = 0.0;
  for (int j = 0; j < laws.parameters; ++j) {
    node.normal[j] = plane.normal[index(j)] / laws.half_width(j);
    norm += node.normal[j] * node.normal[j];
  }
  norm = std::sqrt(norm);
  node.offset = plane.offset / norm;
  for (int j = 0; j < laws.parameters; ++j) {
    node.normal[j] /= norm;
    node.offset += node.normal[j] * laws.centre(j);
  }
  return node;
}

}  // namespace eampc::law_design
