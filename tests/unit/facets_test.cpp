#include "patch/facets.h"

#include "base/error.h"
#include "test_scene.h"

#include <gtest/gtest.h>
#include <set>

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

// Each has its diagonal from the lower left: a triangle of one makes a skew parallelogram with its neighbour's too.
TEST(Facets, JoinTheTrianglesOfARowOfSquaresToSquares) {
  std::vector<std::vector<Vec3>> row;
  for (double x : {0.0, 1.0, 2.0, 3.0}) row.push_back(rectangle(x, 0, x + 1, 1, 0));
  const FacetSet set = facetsOf({{"row", row}});
  ASSERT_EQ(set.facets.size(), 4u);
  for (const Facet& f : set.facets) {
    const Vec3 &o = set.points[f.corners[0]], &a = set.points[f.corners[1]], &b = set.points[f.vCorner()];
    EXPECT_NEAR(glm::dot(a - o, b - o), 0, 1e-9);
  }
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

// A floor of 4 x 4 and what may lie on it.
std::vector<TestSurface> floorAnd(const std::vector<Vec3>& plate, bool twoSided = false) {
  return {{"floor", {rectangle(0, 0, 4, 4, 0)}, Rgb(0.5), Rgb(0), twoSided}, {"plate", {plate}}};
}

TEST(Facets, AreDividedWhereAPlateNearlyTouchesThem) {
  const FacetSet set = facetsOf(floorAnd(rectangle(1, 0.5, 3, 2.5, 0.01)));
  ASSERT_EQ(set.facets.size(), 10u);
  EXPECT_EQ(set.points.size(), 16u + 4u);
  std::vector<double> areas;
  for (size_t f = 0; f < 9; ++f) {
    EXPECT_EQ(set.facets[f].surface, 0u);
    areas.push_back(set.facets[f].area * set.frame.size * set.frame.size);
  }
  const std::vector<double> expected = {0.5, 0.5, 1, 1.5, 1.5, 2, 2, 3, 4};
  std::sort(areas.begin(), areas.end());
  for (size_t f = 0; f < 9; ++f) EXPECT_NEAR(areas[f], expected[f], 1e-5) << f;
}

TEST(Facets, AreDividedAtLinesThatPayOnly) {
  const auto count = [](const std::vector<TestSurface>& surfaces) { return facetsOf(surfaces).facets.size() - 1; };
  EXPECT_EQ(count(floorAnd(rectangle(1, 1, 3, 3, 0))), 9u);                                          // touches
  EXPECT_EQ(count(floorAnd(rectangle(1, 1, 3, 3, 0.2))), 1u);                                        // far
  EXPECT_EQ(count(floorAnd(rectangle(1, 1, 1.5, 1.5, 0.01))), 1u);                                   // small
  EXPECT_EQ(count(floorAnd(rectangle(1, 1, 1.01, 3, 0.01))), 2u);                                    // so thin that it is one line
  EXPECT_EQ(count(floorAnd(rectangle(0.01, 0, 4, 4, 0.01))), 1u);                                    // along the border
  EXPECT_EQ(count(floorAnd({{2, 0.5, 0.01}, {3.5, 2, 0.01}, {2, 3.5, 0.01}, {0.5, 2, 0.01}})), 1u);  // aslant
  EXPECT_EQ(count(floorAnd(rectangle(1, 1, 3, 3, -0.01))), 1u);                                      // behind the black back
  EXPECT_EQ(count(floorAnd(rectangle(1, 1, 3, 3, -0.01), true)), 9u);              // behind, where that is a side too
  EXPECT_EQ(count(floorAnd({{2, 1, -1}, {2, 3, -1}, {2, 3, 1}, {2, 1, 1}})), 3u);  // through the floor: both are
  EXPECT_EQ(count(floorAnd({{2, 1, -1}, {2, 1.5, -1}, {2, 1.5, 1}, {2, 1, 1}})), 1u);
  EXPECT_EQ(count({{"floor", {rectangle(0, 0, 4, 4, 0), rectangle(4, 0, 8, 4, 0)}}}), 1u);  // neighbours in one plane
}

TEST(Facets, TellWhatAPlateEnclosesOnly) {
  const auto regions = [](const std::vector<TestSurface>& surfaces) {
    const FacetSet set = facetsOf(surfaces);
    std::set<uint32_t> found;
    for (const Facet& f : set.facets) {
      if (f.surface == 0) found.insert(f.region);
    }
    return found.size();
  };
  EXPECT_EQ(regions(floorAnd(rectangle(1, 1, 3, 3, 0.01))), 2u);
  EXPECT_EQ(regions(floorAnd(rectangle(0, 1, 4, 3, 0.01))), 3u);                     // from wall to wall
  EXPECT_EQ(regions(floorAnd({{2, 0, -1}, {2, 4, -1}, {2, 4, 1}, {2, 0, 1}})), 2u);  // a partition
  EXPECT_EQ(regions(floorAnd({{2, 1, -1}, {2, 4, -1}, {2, 4, 1}, {2, 1, 1}})), 1u);  // but for a quarter
  EXPECT_EQ(regions(floorAnd(rectangle(1, 1, 3, 3, 0.2))), 1u);
}

// The colour of a point is the same on the whole and on the part that it lies on.
TEST(Facets, KeepTheirColoursWhereDivided) {
  Scene scene = loadSurfaces(floorAnd(rectangle(1, 1, 2.5, 3.5, 0.01)));
  scene.surfaces[0].colors.clear();
  for (const Vec3& p : scene.surfaces[0].positions) scene.surfaces[0].colors.push_back(Rgb(p.x / 4, p.y / 4, 0.5));
  Log log(true);
  const FacetSet set = buildFacets(scene, log);
  ASSERT_EQ(set.facets.size(), 10u);
  for (size_t f = 0; f < 9; ++f) {
    const Vec3 at = set.frame.toScene(set.point(set.facets[f], 0.25, 0.75));
    const Rgb colour = attributesAt(scene.surfaces[0], set.facets[f], 0.25, 0.75).color;
    EXPECT_NEAR(colour.r, at.x / 4, 1e-6);
    EXPECT_NEAR(colour.g, at.y / 4, 1e-6);
  }
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
