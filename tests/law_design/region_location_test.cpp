#include "law_design/region_location.hpp"

#include <gtest/gtest.h>

#include <array>

namespace eampc::law_design {
namespace {

// [0, 1], [1, 2] and [3, 4] on a line: the last is linked to nothing.
struct Line {
  std::array<std::int64_t, 4> facet_first{0, 2, 4, 6};
  std::array<double, 6> normals{-1.0, 1.0, -1.0, 1.0, -1.0, 1.0};
  std::array<double, 6> offsets{0.0, 1.0, -1.0, 2.0, -3.0, 4.0};
  std::array<std::int8_t, 6> kinds{1, 0, 0, 3, 3, 1};
  std::array<std::int64_t, 7> neighbour_first{0, 0, 1, 2, 2, 2, 2};
  std::array<std::int32_t, 2> neighbours{1, 0};

  RegionArrays arrays() const {
    return {1, facet_first, normals, offsets, kinds, neighbour_first, neighbours};
  }
};

TEST(RegionLocation, FindsTheRegionFromAnyStart) {
  const Line line;
  ASSERT_TRUE(line.arrays().valid());
  for (int start = 0; start < 3; ++start) {
    for (const auto& [p, region] : {std::pair{0.5, 0}, {1.5, 1}, {3.5, 2}, {2.5, -1}, {-0.1, -1}}) {
      EXPECT_EQ(locate(line.arrays(), &p, start, 1e-9), region) << p << " from " << start;
    }
  }
}

TEST(RegionLocation, AFacetBelongsToItsRegion) {
  const Line line;
  const double p = 2.0 + 0.5e-9;
  EXPECT_EQ(locate(line.arrays(), &p, 0, 1e-9), 1);
  EXPECT_EQ(locate(line.arrays(), &p, 0, 1e-10), -1);
}

TEST(RegionLocation, RefusesArraysThatPointOutside) {
  Line line;
  line.neighbours[1] = 3;
  EXPECT_FALSE(line.arrays().valid());
  line = {};
  line.neighbours[0] = -1;
  EXPECT_FALSE(line.arrays().valid());
  line = {};
  line.facet_first = {0, 4, 2, 6};
  EXPECT_FALSE(line.arrays().valid());
  line = {};
  line.neighbour_first[6] = 3;
  EXPECT_FALSE(line.arrays().valid());
  line = {};
  RegionArrays arrays = line.arrays();
  arrays.parameters = 2;
  EXPECT_FALSE(arrays.valid());
}

}  // namespace
}  // namespace eampc::law_design
