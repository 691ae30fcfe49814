#include "law_design/region_location.hpp"

#include <cstddef>

namespace eampc::law_design {
namespace {

struct Excess {
  std::int64_t facet = -1;
  double value = 0.0;
};

Excess worst_facet(const RegionArrays& arrays, const double* p, int region) {
  const auto np = static_cast<std::size_t>(arrays.parameters);
  Excess worst;
  const auto r = static_cast<std::size_t>(region);
  for (std::int64_t f = arrays.facet_first[r]; f < arrays.facet_first[r + 1]; ++f) {
    const auto facet = static_cast<std::size_t>(f);
    const double* normal = arrays.normals.data() + facet * np;
    double excess = -arrays.offsets[facet];
    for (std::size_t j = 0; j < np; ++j) excess += normal[j] * p[j];
    if (worst.facet < 0 || excess > worst.value) worst = {f, excess};
  }
  return worst;
}

// Steps after which a walk counts as lost: walks to the worst facet may go in circles.
constexpr int kWalk = 200;

template <typename T, typename I>
bool rises(std::span<const T> first, I end) {
  if (first.empty() || first.front() != 0 || static_cast<I>(first.back()) != end) return false;
  for (std::size_t i = 1; i < first.size(); ++i) {
    if (first[i] < first[i - 1]) return false;
  }
  return true;
}

}  // namespace

bool RegionArrays::valid() const {
  const std::size_t facets = offsets.size();
  if (parameters < 1 || !rises(facet_first, facets) || kinds.size() != facets) return false;
  if (normals.size() != facets * static_cast<std::size_t>(parameters)) return false;
  if (neighbour_first.size() != facets + 1 || !rises(neighbour_first, neighbours.size())) {
    return false;
  }
  for (const std::int32_t neighbour : neighbours) {
    if (neighbour < 0 || neighbour >= regions()) return false;
  }
  return true;
}

int locate(const RegionArrays& arrays, const double* p, int start, double tolerance) {
  int region = start;
  for (int step = 0; step < kWalk; ++step) {
    const Excess worst = worst_facet(arrays, p, region);
    if (worst.facet < 0 || worst.value <= tolerance) return region;
    const auto facet = static_cast<std::size_t>(worst.facet);
    int next = -1;
    double least = 0.0;
    for (std::int64_t k = arrays.neighbour_first[facet]; k < arrays.neighbour_first[facet + 1];
         ++k) {
      const int neighbour = arrays.neighbours[static_cast<std::size_t>(k)];
      const double excess = worst_facet(arrays, p, neighbour).value;
      if (next < 0 || excess < least) {
        next = neighbour;
        least = excess;
      }
    }
    if (next < 0) break;
    region = next;
  }
  for (int r = 0; r < arrays.regions(); ++r) {
    if (worst_facet(arrays, p, r).value <= tolerance) return r;
  }
  return -1;
}

}  // namespace eampc::law_design
