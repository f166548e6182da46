#include "patch/facets.h"

#include "base/error.h"
#include "test_scene.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

FacetSet facetsOf(const std::vector<TestSurface>& surfaces) {
  Log log(true);
  return buildFacets(loadSurfaces(surfaces), log);
}

TEST(Facets, JoinTwoTrianglesToAParallelogram) {
  const FacetSet set = facetsOf({{"skew", {{{0, 0, 0}, {2, 0, 0}, {3, 1, 0}, {1, 1, 0}}}}});
  ASSERT_EQ(set.facets.size(), 1u);
  EXPECT_TRUE(set.facets[0].parallelogram);
  EXPECT_NEAR(set.facets[0].area * set.frame.size * set.frame.size, 2.0, 1e-6);
  EXPECT_NEAR(set.facets[0].normal.z, 1, 1e-12);
}

TEST(Facets, KeepTrianglesThatMakeNoParallelogram) {
  EXPECT_EQ(facetsOf({{"kite", {{{0, 0, 0}, {2, 0, 0}, {3, 3, 0}, {0, 2, 0}}}}}).facets.size(), 2u);
  // Folded along the diagonal: the fourth corner is out of the plane.
  EXPECT_EQ(facetsOf({{"fold", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0.01}, {0, 1, 0}}}}}).facets.size(), 2u);
}

// 1 - 0.8 - 0.2 is -5.6e-17 in double, and no reflectance is below 0.
TEST(Facets, BlendColoursToNoLessThanNothing) {
  Surface surface;
  surface.colors = {Rgb(1), Rgb(0), Rgb(0)};
  Facet facet{};
  facet.vertices = {0, 1, 2};
  EXPECT_LT(1 - 0.8 - 0.2, 0);
  EXPECT_EQ(attributesAt(surface, facet, 0.8, 0.2).color, Rgb(0));
  EXPECT_EQ(attributesAt(surface, facet, 0.25, 0.25).color, Rgb(0.5));
}

TEST(Facets, LeaveOutDegenerateAndDuplicateTriangles) {
  const std::vector<Vec3> good = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const FacetSet set = facetsOf(
      {{"t",
        {good, good, {{0, 0, 0}, {1, 0, 0}, {1, 0, 0}}, {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}}});
  EXPECT_EQ(set.facets.size(), 1u);
  EXPECT_EQ(set.duplicate, 1u);
  EXPECT_EQ(set.degenerate, 3u);
}

// Found by fuzzing: the loader keeps vertices that no triangle uses, and they may lie anywhere.
TEST(Facets, HearNothingOfVerticesThatNoTriangleUses) {
  Scene scene = loadSurfaces(closedBox({1, 1, 1}));
  scene.surfaces[0].positions.emplace_back(1e38, -1e38, 1e30);
  scene.surfaces[1].positions.emplace_back(1e-7, 0, 0);
  Log log(true);
  const FacetSet set = buildFacets(scene, log);
  EXPECT_EQ(set.points.size(), 8u);
  EXPECT_EQ(set.welded, 0u);
}

TEST(Facets, RefuseASceneOfDegenerateTriangles) { EXPECT_THROW(facetsOf({{"line", {{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}}}}), Error); }

TEST(Facets, NoticeTrianglesThatFaceOppositeWays) {
  EXPECT_TRUE(facetsOf({{"a", {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}}, {"b", {{{0, 0, 0}, {0, 1, 0}, {1, 0, 0}}}}}).hasTwins);
  EXPECT_FALSE(facetsOf(closedBox({1, 1, 1})).hasTwins);
}

TEST(Facets, WeldVerticesOfNeighbouringSurfaces) { EXPECT_EQ(facetsOf(closedBox({1, 2, 3})).points.size(), 8u); }

}  // namespace
}  // namespace farol::test
