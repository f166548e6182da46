#include "base/point_welder.h"

#include <gtest/gtest.h>

namespace farol {
namespace {

TEST(PointWelder, JoinsPointsWithinTheToleranceAcrossGridCells) {
  PointWelder welder(1e-3);
  const uint32_t first = welder.add({0, 0, 0});
  EXPECT_EQ(welder.add({-0.0005, 0.0005, -0.0005}), first);
  EXPECT_NE(welder.add({0.0021, 0, 0}), first);
  EXPECT_EQ(welder.points().size(), 2u);
}

TEST(PointWelder, CountsOnlyPointsThatReallyMove) {
  PointWelder welder(1e-3);
  welder.add({1, 2, 3});
  welder.add({1, 2, 3});
  EXPECT_EQ(welder.movedCount(), 0u);
  welder.add({1, 2, 3.0001});
  EXPECT_EQ(welder.movedCount(), 1u);
}

}  // namespace
}  // namespace farol
