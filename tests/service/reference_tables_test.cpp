#include "service/reference_tables.hpp"

#include <gtest/gtest.h>

namespace eampc::service {
namespace {

TEST(ReferenceTables, KeepsAddressesAndBoundsTheWhole) {
  ReferenceTables tables;
  const control::Reference* first = tables.keep(std::vector<control::Reference>(100, {0.5, 0, 0}));
  ASSERT_NE(first, nullptr);
  for (int i = 0; i < 50; ++i) ASSERT_NE(tables.keep(std::vector<control::Reference>(10)), nullptr);
  EXPECT_EQ(first[99].angle_rad, 0.5);
  EXPECT_EQ(tables.rows(), 600u);
  EXPECT_EQ(tables.keep(std::vector<control::Reference>(ReferenceTables::kMaxRows)), nullptr);

  realtime::ReleasedTableQueue released;
  released.push(first);
  tables.collect(released);
  EXPECT_EQ(tables.rows(), 500u);
}

}  // namespace
}  // namespace eampc::service
