// Critical regions as flat arrays, and the search for the region that holds a parameter: a walk
// through the facets, with a look at every region where the walk does not end.
#pragma once

#include <cstdint>
#include <span>

namespace eampc::law_design {

/// What lies beyond a facet of a critical region.
enum class FacetKind : std::int8_t {
  kInner = 0,         ///< other regions: its neighbours
  kBox = 1,           ///< nothing: a face of the parameter box
  kParameterRow = 2,  ///< no solution: a row of the problem that bounds parameters only
  kInfeasible = 3,    ///< no solution: the rows contradict each other
  kSaturated = 4,     ///< a region left out because of MpQpOptions::output
};

/// Facets of region r are facet_first[r] .. facet_first[r+1)-1, neighbours of facet f
/// neighbour_first[f] .. neighbour_first[f+1)-1.
struct RegionArrays {
  int parameters = 0;
  std::span<const std::int64_t> facet_first;
  std::span<const double> normals;  ///< row-major, a facet's unit normal per row
  std::span<const double> offsets;
  std::span<const std::int8_t> kinds;  ///< FacetKind
  std::span<const std::int64_t> neighbour_first;
  std::span<const std::int32_t> neighbours;

  /// False if an index points out of its array.
  bool valid() const;
  int regions() const { return static_cast<int>(facet_first.size()) - 1; }
};

/// Index of a region that holds p to within `tolerance` of its facets, else -1. The walk starts at
/// region `start`.
int locate(const RegionArrays& arrays, const double* p, int start, double tolerance);

}  // namespace eampc::law_design
