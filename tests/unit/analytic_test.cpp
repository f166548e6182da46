#include "formfactor/analytic.h"

#include <gtest/gtest.h>

namespace farol {
namespace {

const Vec3 kUp(0, 0, 1), kOrigin(0);

// Element below one corner of a parallel unit square at distance 1 (Howell, B-3).
TEST(PointToPolygon, MatchesTheParallelSquareAboveItsCorner) {
  const std::vector<Vec3> square = {{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}};
  EXPECT_NEAR(pointToPolygon(kOrigin, kUp, square), 0.138531605994893, 1e-14);
}

// A tall wall through the horizon counts with its upper part only: truth case A7d.
TEST(PointToPolygon, ClipsAtTheHorizon) {
  const std::vector<Vec3> wall = {{0.5, -0.5, -1}, {0.5, -0.5, 1}, {0.5, 0.5, 1}, {0.5, 0.5, -1}};
  const std::vector<Vec3> upper = {{0.5, -0.5, 0}, {0.5, -0.5, 1}, {0.5, 0.5, 1}, {0.5, 0.5, 0}};
  EXPECT_NEAR(pointToPolygon(kOrigin, kUp, wall), pointToPolygon(kOrigin, kUp, upper), 1e-15);
  EXPECT_GT(pointToPolygon(kOrigin, kUp, wall), 0.1);
}

TEST(PointToPolygon, IsZeroFromBehindAndInItsOwnPlane) {
  const std::vector<Vec3> away = {{1, 0, 1}, {1, 1, 1}, {0, 1, 1}, {0, 0, 1}};
  const std::vector<Vec3> coplanar = {{1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}};
  EXPECT_EQ(pointToPolygon(kOrigin, kUp, away), 0.0);
  EXPECT_EQ(pointToPolygon(kOrigin, kUp, coplanar), 0.0);
}

TEST(PointToPolygon, SumsToOneInsideABox) {
  const Vec3 p(0.3, 0.6, 0);
  const std::vector<std::vector<Vec3>> box = {{{0, 0, 0}, {0, 1, 0}, {0, 1, 1}, {0, 0, 1}},
                                              {{1, 0, 0}, {1, 0, 1}, {1, 1, 1}, {1, 1, 0}},
                                              {{0, 0, 0}, {0, 0, 1}, {1, 0, 1}, {1, 0, 0}},
                                              {{0, 1, 0}, {1, 1, 0}, {1, 1, 1}, {0, 1, 1}},
                                              {{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}}};
  double sum = 0;
  for (const auto& face : box) sum += pointToPolygon(p, kUp, face);
  EXPECT_NEAR(sum, 1.0, 1e-14);
}

}  // namespace
}  // namespace farol
