#include "solve/node_irradiance.h"

#include "patch/patch_tree.h"
#include "test_scene.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

struct Field {
  Field(const std::vector<TestSurface>& surfaces, size_t count, double (*value)(const Vec3&))
      : Field(surfaces, PatchOptions{count, 0}, value, {}) {}
  Field(const std::vector<TestSurface>& surfaces, const PatchOptions& options, double (*value)(const Vec3&), const PatchTree& tree)
      : scene(loadSurfaces(surfaces)) {
    Log log(true);
    facets = buildFacets(scene, log);
    patches = buildPatches(scene, facets, options, tree);
    for (const Patch& p : patches.patches) irradiance.emplace_back(value(p.centre));
    nodes.emplace_back(scene, facets, patches, nullptr, irradiance);
  }
  double at(uint32_t facet, double u, double v) const { return nodes[0].at(facet, false, u, v).r; }
  // At a point of a rectangular facet [scene units].
  double valueAt(uint32_t facet, const Vec3& p) const {
    const Facet& t = facets.facets[facet];
    const Vec3 o = facets.points[t.corners[0]], a = facets.points[t.corners[1]] - o, b = facets.points[t.vCorner()] - o;
    const Vec3 d = facets.frame.toUnit(p) - o;
    return at(facet, glm::dot(d, a) / glm::dot(a, a), glm::dot(d, b) / glm::dot(b, b));
  }
  Scene scene;
  FacetSet facets;
  PatchSet patches;
  std::vector<Rgb> irradiance;
  std::vector<NodeIrradiance> nodes;
};

TEST(NodeIrradiance, KeepsAConstantExactly) {
  const Field f({{"q", {{{0, 0, 0}, {3, 0, 0}, {3, 2, 0}, {0, 2, 0}}}}, {"t", {{{4, 0, 0}, {7, 0, 0}, {4, 2, 0}}}}}, 200,
                [](const Vec3&) { return 2.5; });
  for (uint32_t facet = 0; facet < 2; ++facet) {
    for (double u = 0; u <= 1; u += 0.09) {
      for (double v = 0; u + v <= 1; v += 0.07) EXPECT_NEAR(f.at(facet, u, v), 2.5, 1e-12);
    }
  }
}

// Inside, the mean of cells around a node reproduces a linear function.
TEST(NodeIrradiance, FollowsALinearFunctionInside) {
  const Field f({{"q", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}}, 400, [](const Vec3& p) { return p.x + 2 * p.y; });
  const Facet& facet = f.facets.facets[0];
  for (const Vec2 uv : {Vec2(0.3, 0.6), Vec2(0.52, 0.5), Vec2(0.77, 0.21)}) {
    const Vec3 p = f.facets.frame.toScene(f.facets.point(facet, uv.x, uv.y));
    EXPECT_NEAR(f.at(0, uv.x, uv.y), p.x + 2 * p.y, 1e-6);
  }
}

// Two rectangles of one floor with edges of different length: no seam beyond second order along the shared line.
TEST(NodeIrradiance, HasNoSeamBetweenFacetsOfOnePlane) {
  const Field f(
      {{"left", {{{0, 0, 0}, {1, 0, 0}, {1, 2, 0}, {0, 2, 0}}}}, {"right", {{{1, 0.3, 0}, {2, 0.3, 0}, {2, 1.6, 0}, {1, 1.6, 0}}}}},
      400, [](const Vec3& p) { return 1 + p.x + 0.5 * p.y; });
  for (double y = 0.4; y < 1.5; y += 0.013)
    EXPECT_NEAR(f.valueAt(0, {1, y, 0}), f.valueAt(1, {1, y, 0}), 0.03) << y;  // the two sides' cells differ by 0.1
}

// Grids that almost agree (edges of 1 and 2.003, 10 and 20 cells): nodes that nearly coincide share their cells, too.
TEST(NodeIrradiance, HasNoSeamWhereNodesNearlyCoincide) {
  const Field f(
      {{"left", {{{0, 0, 0}, {1, 0, 0}, {1, 2.003, 0}, {0, 2.003, 0}}}}, {"right", {{{1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}}}}},
      300, [](const Vec3& p) { return 1 + p.x; });
  const auto across = [&](double y) { return f.valueAt(0, {1, y, 0}) - f.valueAt(1, {1, y, 0}); };
  // (not along the last cell: beyond the corner at y = 1 the left one has no neighbour)
  for (double y = 0; y < 0.88; y += 0.01) EXPECT_NEAR(across(y), 0, 1e-3) << y;  // the two sides' cells differ by 0.1
}

// Grids of different steps on one line: the field that both sides follow is linear along it, and so are they.
TEST(NodeIrradiance, HasNoSeamBetweenGridsOfDifferentSteps) {
  const Field f({{"left", {{{0, 0, 0}, {1, 0, 0}, {1, 2.6, 0}, {0, 2.6, 0}}}},
                 {"right", {{{1, 0, 0}, {2, 0, 0}, {2, 1.13, 0}, {1, 1.13, 0}}}}},
                200, [](const Vec3& p) { return 1 + p.y; });
  for (double y = 0.2; y < 0.9; y += 0.01) EXPECT_NEAR(f.valueAt(0, {1, y, 0}), f.valueAt(1, {1, y, 0}), 1e-3) << y;
}

// A crease stays sharp: floor and wall meet with their own values.
// A plate close to the floor: what is under it is dark, and beside it the light does not fade towards that. Around it, where
// lines only go on, there is no seam.
TEST(NodeIrradiance, IsNotSmoothedWhereAPlateEndsTheLight) {
  const Field f({{"floor", {rectangle(0, 0, 4, 4, 0)}}, {"plate", {rectangle(1, 1, 3, 3, 0.01)}}}, 400,
                [](const Vec3& p) { return p.x > 1 && p.x < 3 && p.y > 1 && p.y < 3 ? 0.0 : 1 + p.x; });
  ASSERT_EQ(f.facets.facets.size(), 10u);
  const auto at = [&](double x, double y, double towards) {  // by the part that lies on that side
    for (uint32_t facet = 0; facet < 9; ++facet) {
      const Facet& part = f.facets.facets[facet];
      const Vec3 d = f.facets.frame.toUnit({x + towards, y, 0}) - f.facets.points[part.corners[0]];
      const Vec3 a = f.facets.points[part.corners[1]] - f.facets.points[part.corners[0]],
                 b = f.facets.points[part.vCorner()] - f.facets.points[part.corners[0]];
      const double u = glm::dot(d, a) / glm::dot(a, a), v = glm::dot(d, b) / glm::dot(b, b);
      if (u >= 0 && u <= 1 && v >= 0 && v <= 1) return f.valueAt(facet, {x, y, 0});
    }
    return -1.0;
  };
  const double cell = 0.2;
  EXPECT_NEAR(at(1, 2, -0.01), 2, cell);  // the mean of the cells there, all on one side
  EXPECT_EQ(at(1, 2, 0.01), 0);
  EXPECT_NEAR(at(1, 0.5, -0.01), at(1, 0.5, 0.01), 1e-12);
  EXPECT_NEAR(at(1, 0.5, 0.01), 2, 0.1 * cell);  // cells of both sides differ a little in width
}

TEST(NodeIrradiance, KeepsCreasesSharp) {
  const Field f(
      {{"floor", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}, {"wall", {{{0, 0, 0}, {0, 1, 0}, {0, 1, 1}, {0, 0, 1}}}}}, 200,
      [](const Vec3& p) { return p.z > 0 ? 5.0 : 1.0; });
  for (uint32_t facet = 0; facet < 2; ++facet) {
    for (const Vec2 uv : {Vec2(0, 0), Vec2(1, 0), Vec2(0, 1), Vec2(0.5, 0), Vec2(0, 0.5)})
      EXPECT_NEAR(f.at(facet, uv.x, uv.y), facet == 0 ? 1 : 5, 1e-12);
  }
}

// A square of patches of three sizes.
Field squareOfSizes(double (*value)(const Vec3&)) {
  PatchTree tree;
  tree.split(0, false, 0, 0);
  for (uint32_t quarter = 0; quarter < 4; ++quarter) tree.split(0, false, 1, quarter);
  for (const uint32_t part : {0u, 5u, 6u, 10u}) tree.split(0, false, 2, part);
  return {{{"q", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}}, {0, 10}, value, tree};
}

// Without smoothing, a slope within a large patch would be lost.
TEST(NodeIrradiance, FollowsASlopeThroughPatchesOfManySizes) {
  const Field s = squareOfSizes([](const Vec3& p) { return 1 + p.x; });
  ASSERT_EQ(s.patches.size(), 28u);
  const Vec3 origin = s.facets.frame.toScene(s.facets.point(s.facets.facets[0], 0, 0));
  const double alongU = s.facets.frame.toScene(s.facets.point(s.facets.facets[0], 1, 0)).x - origin.x;
  const double alongV = s.facets.frame.toScene(s.facets.point(s.facets.facets[0], 0, 1)).x - origin.x;
  // Patches away from the facet's border keep their means but for what nodes between cells even out.
  size_t inside = 0;
  for (uint32_t p = 0; p < s.patches.size(); ++p) {
    double mean = 0;
    bool atBorder = false;
    const auto cells = s.patches.cellsOf(p);
    for (const uint32_t c : cells) {
      const Cell& cell = s.patches.cells[c];
      const CellGrid& grid = s.patches.grids[0];
      atBorder |= cell.u == 0 || cell.v == 0 || cell.u + 1 == grid.nu || cell.v + 1 == grid.nv;
      mean += s.at(0, (cell.u + 0.5) / grid.nu, (cell.v + 0.5) / grid.nv) / static_cast<double>(cells.size());
    }
    if (atBorder) continue;
    ++inside;
    EXPECT_NEAR(mean, s.irradiance[p].r, 0.01) << p;
  }
  EXPECT_GT(inside, 5u);
  for (double u = 0.26; u < 0.75; u += 0.04) {
    for (double v = 0.26; v < 0.75; v += 0.04)
      EXPECT_NEAR(s.at(0, u, v), 1 + origin.x + u * alongU + v * alongV, 0.025) << u << " " << v;
  }
}

TEST(NodeIrradiance, HardlyOvershootsAtAStep) {
  const Field s = squareOfSizes([](const Vec3& p) { return p.x + p.y < 1 ? 0.0 : 1.0; });
  for (double u = 0; u <= 1; u += 0.01) {
    for (double v = 0; v <= 1; v += 0.01) {
      EXPECT_GE(s.at(0, u, v), -1e-12);
      EXPECT_LE(s.at(0, u, v), 1.5);
    }
  }
}

}  // namespace
}  // namespace farol::test
