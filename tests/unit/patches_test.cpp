#include "base/error.h"
#include "patch/patch_tree.h"
#include "patch/positions.h"
#include "test_scene.h"

#include <gtest/gtest.h>
#include <map>
#include <set>

namespace farol::test {
namespace {

struct Cut {
  explicit Cut(Scene s, const PatchOptions& options) : scene(std::move(s)) {
    Log log(true);
    facets = buildFacets(scene, log);
    patches = buildPatches(scene, facets, options);
  }
  Scene scene;
  FacetSet facets;
  PatchSet patches;
};

Cut boxOf(const Vec3& size, const PatchOptions& options) { return Cut(loadSurfaces(closedBox(size)), options); }

double areaOf(const Cut& cut) {
  double sum = 0;
  for (const Patch& p : cut.patches.patches) sum += p.area;
  return sum;
}

TEST(Patches, AreasSumToTheAreaOfTheScene) {
  for (const size_t count : {6u, 100u, 5000u}) EXPECT_NEAR(areaOf(boxOf({1, 2, 3}, {count, 0})), 22.0, 22 * 1e-6);
  Log log(true);
  for (const char* name : {"/cornell_box/cornell_box.gltf", "/l_room/l_room.gltf"}) {
    const Scene scene = loadScene(std::string(FAROL_SCENES) + name, log);
    double triangles = 0;
    for (const Surface& s : scene.surfaces) {
      for (const auto& t : s.triangles)
        triangles += 0.5 * glm::length(glm::cross(s.positions[t[1]] - s.positions[t[0]], s.positions[t[2]] - s.positions[t[0]]));
    }
    EXPECT_NEAR(areaOf(Cut(scene, {3000, 0})), triangles, 1e-6 * triangles) << name;
  }
}

// An edge of length l gets ceil(l / S) cells.
TEST(Patches, FollowThePatchSize) {
  const Cut cut = boxOf({1, 2, 3}, {0, 0.5});
  for (size_t f = 0; f < cut.facets.facets.size(); ++f) {
    const Facet& facet = cut.facets.facets[f];
    const double size = cut.facets.frame.size;
    EXPECT_EQ(cut.patches.grids[f].nu,
              std::lround(2 * size * glm::distance(cut.facets.points[facet.corners[0]], cut.facets.points[facet.corners[1]])));
  }
  EXPECT_EQ(cut.patches.size(), 2u * (4 * 6 + 2 * 6 + 2 * 4));
  EXPECT_EQ(boxOf({1, 1, 1}, {0, 0.3}).patches.size(), 6u * 16);
  EXPECT_EQ(boxOf({1, 1, 1}, {0, 7}).patches.size(), 6u);
}

TEST(Patches, ComeCloseToTheNumberAskedFor) {
  for (const size_t count : {600u, 4000u, 20000u})
    EXPECT_NEAR(static_cast<double>(boxOf({1, 2, 3}, {count, 0}).patches.size()), static_cast<double>(count),
                0.1 * static_cast<double>(count));
}

TEST(Patches, RefuseASizeThatMakesTooMany) { EXPECT_THROW(boxOf({1, 1, 1}, {0, 1e-6}), Error); }

// Every cell's own centre is found again from its (u,v), on parallelograms and on triangles.
TEST(Cells, AreFoundFromTheirCentres) {
  for (const bool parallelogram : {true, false}) {
    Scene scene = loadSurfaces({parallelogram ? TestSurface{"q", {{{0, 0, 0}, {3, 0, 0}, {3, 2, 0}, {0, 2, 0}}}}
                                              : TestSurface{"t", {{{0, 0, 0}, {3, 0, 0}, {0, 2, 0}}}}});
    const Cut cut(std::move(scene), {300, 0});
    double area = 0;
    for (uint32_t c = 0; c < cut.patches.cells.size(); ++c) {
      const Cell& cell = cut.patches.cells[c];
      const double middle = parallelogram ? 0.5 : 1.0 / 3;
      const Vec2 uv = cellPoint(cut.patches.grids[0], parallelogram, cell, middle, middle);
      ASSERT_EQ(cellAt(cut.patches.grids[0], parallelogram, uv.x, uv.y), c);
      area += cellArea(cut.facets, cut.patches.grids[0], 0);
    }
    EXPECT_NEAR(area, parallelogram ? 6 : 3, 1e-6);
  }
}

TEST(Cells, MayShareAPatch) {
  Cut cut = boxOf({1, 1, 1}, {24, 0});
  std::vector<uint32_t> map(24);
  for (uint32_t c = 0; c < 24; ++c) map[c] = c / 4;
  mapCells(cut.patches, cut.scene, cut.facets, map);
  ASSERT_EQ(cut.patches.size(), 6u);
  EXPECT_NEAR(cut.patches.patches[0].area, 1, 1e-6);
  EXPECT_NEAR(glm::distance(cut.patches.patches[0].centre, Vec3(0, 0.5, 0.5)), 0, 1e-6);
  // Positions spread over all four cells.
  std::set<int> quarters;
  for (const Position& p : positionsOn(cut.facets, cut.patches, 0, 16, 1)) {
    const Vec3 q = cut.facets.frame.toScene(p.point);
    quarters.insert((q.y > 0.5 ? 1 : 0) + (q.z > 0.5 ? 2 : 0));
  }
  EXPECT_EQ(quarters.size(), 4u);
}

// Gauss positions integrate polynomials over a cell exactly: degree 2n - 1 on squares, 2n - 2 on triangles.
TEST(Positions, IntegratePolynomialsExactly) {
  const Cut square(loadSurfaces({{"q", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}}), {1, 0});
  const Cut triangle(loadSurfaces({{"t", {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}}}), {1, 0});
  double onSquare = 0, onTriangle = 0, weights = 0;
  for (const Position& p : positionsOn(square.facets, square.patches, 0, 9, 1)) {
    const Vec3 q = square.facets.frame.toScene(p.point);
    onSquare += p.weight * std::pow(q.x, 5) * std::pow(q.y, 4);
  }
  for (const Position& p : positionsOn(triangle.facets, triangle.patches, 0, 9, 1)) {
    const Vec3 q = triangle.facets.frame.toScene(p.point);
    onTriangle += p.weight * q.x * q.x * q.y * q.y;
    weights += p.weight;
  }
  EXPECT_NEAR(onSquare, 1.0 / 6 / 5, 1e-9);
  EXPECT_NEAR(onTriangle, 2 * 4.0 / 720, 1e-9);  // 2 int x^2 y^2 = 2 * 2! 2! / 6!
  EXPECT_NEAR(weights, 1, 1e-14);
}

TEST(Positions, LieOnTheirPatchForEveryCount) {
  const Cut cut(loadSurfaces({{"t", {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}}}), {16, 0});
  for (const int count : {1, 2, 4, 7, 9, 30}) {
    for (uint32_t i = 0; i < cut.patches.size(); ++i) {
      double weight = 0;
      for (const Position& p : positionsOn(cut.facets, cut.patches, i, count, i)) {
        weight += p.weight;
        const Vec3 q = cut.facets.frame.toScene(p.point);
        ASSERT_EQ(cellAt(cut.patches.grids[0], false, q.x, q.y), i);
      }
      EXPECT_NEAR(weight, 1, 1e-12);
    }
  }
}

TEST(Gauss, RulesAreTheKnownOnes) {
  const GaussRule two = gaussLegendre(2);
  EXPECT_NEAR(two.nodes[0], 0.5 - 0.5 / std::sqrt(3.0), 1e-15);
  EXPECT_NEAR(two.weights[0], 0.5, 1e-15);
  double sum = 0;
  for (const double w : gaussLegendre(31).weights) sum += w;
  EXPECT_NEAR(sum, 1, 1e-13);
}

// A cell's four parts lie in it, on parallelograms and triangles.
TEST(Patches, CellsHaveFourPartsEach) {
  for (const bool parallelogram : {true, false}) {
    const CellGrid coarse{5, parallelogram ? 3u : 5u, 0, kNone}, fine{10, parallelogram ? 6u : 10u, 0, kNone};
    std::vector<uint32_t> parent(fine.count(parallelogram), kNone);
    for (uint32_t v = 0, number = 0; v < fine.nv; ++v) {
      const uint32_t width = parallelogram ? fine.nu : 2 * (fine.nu - v) - 1;
      for (uint32_t k = 0; k < width; ++k, ++number)
        parent[number] =
            coarserCell(fine, parallelogram, {0, false, parallelogram ? k : k / 2, v, !parallelogram && k % 2 == 1}, 1);
    }
    std::set<uint32_t> seen;
    for (uint32_t cell = 0; cell < coarse.count(parallelogram); ++cell) {
      for (const uint32_t part : finerCells(coarse, parallelogram, cell)) {
        EXPECT_EQ(parent.at(part), cell);
        seen.insert(part);
      }
    }
    EXPECT_EQ(seen.size(), parent.size());
  }
}

// Splitting one node of a square and of a triangle, and one of its parts again.
TEST(Patches, OfATreeCoverTheirFacets) {
  Cut cut(
      loadSurfaces({{"square", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}, {"triangle", {{{0, 0, 1}, {1, 0, 1}, {0, 1, 1}}}}}),
      {0, 10});
  ASSERT_EQ(cut.facets.facets.size(), 2u);
  PatchTree tree;
  for (uint32_t facet = 0; facet < 2; ++facet) {
    tree.split(facet, false, 0, 0);
    tree.split(facet, false, 1, 1);
  }
  EXPECT_EQ(tree.levels(), 2u);
  const PatchSet patches = buildPatches(cut.scene, cut.facets, {0, 10}, tree);
  ASSERT_EQ(patches.size(), 14u);
  std::map<uint32_t, std::multiset<double>> shares;
  for (const Patch& p : patches.patches) shares[p.surface].insert(std::round(64 * p.area / (p.surface == 0 ? 1.0 : 0.5)));
  for (const auto& [surface, found] : shares) {
    EXPECT_EQ(found.count(16), 3u) << surface;
    EXPECT_EQ(found.count(4), 4u) << surface;
  }
  // Four siblings become their parent; what has a split sibling stays.
  const std::vector<uint32_t> siblings = joinedSiblings(patches, cut.facets, 2);
  std::map<uint32_t, std::pair<size_t, double>> joined;
  for (uint32_t p = 0; p < patches.size(); ++p) {
    auto& [count, area] = joined[siblings[p]];
    ++count;
    area += patches.patches[p].area / (patches.patches[p].surface == 0 ? 1.0 : 0.5);
  }
  ASSERT_EQ(joined.size(), 8u);
  EXPECT_EQ(joined.rbegin()->first, 7u);
  for (const auto& [number, family] : joined) {
    EXPECT_TRUE(family.first == 1 || family.first == 4) << number;
    EXPECT_NEAR(family.second, 0.25, 1e-12) << number;
  }
}

// Patches lie in those of twice the size: on even grids as cells are joined two by two, and each in itself.
TEST(Patches, JoinToLargerOnes) {
  const Scene scene = loadSurfaces(closedBox({1, 2, 3}));
  const Cut fine(scene, {1, 0.125}), wide(scene, {1, 0.25});
  const std::vector<uint32_t> joined = joinedTo(wide.patches, fine.patches, fine.facets),
                              byTwo = joinedCells(fine.patches, fine.facets, 2);
  std::map<uint32_t, uint32_t> known;
  for (uint32_t p = 0; p < fine.patches.size(); ++p)
    EXPECT_EQ(known.try_emplace(byTwo[fine.patches.cellsOf(p)[0]], joined[p]).first->second, joined[p]);
  EXPECT_EQ(known.size(), wide.patches.size());
  // From a cell before the corners: sides of 8, 16 and 24 cells make 5, 9 and 13, and the first cell is by itself.
  const std::vector<uint32_t> shifted = joinedCells(fine.patches, fine.facets, 2, 1);
  EXPECT_EQ(std::set<uint32_t>(shifted.begin(), shifted.end()).size(), 2u * (5 * 9 + 5 * 13 + 9 * 13));
  EXPECT_NE(shifted[0], shifted[1]);
  EXPECT_EQ(shifted[1], shifted[2]);
  PatchOptions options{1, 0.4};
  options.cluster = 15;
  const Cut ball(loadSurfaces({bumpyBall(2000, {0, 0, 1.2})}), options);
  const std::vector<uint32_t> own = joinedTo(ball.patches, ball.patches, ball.facets);
  for (uint32_t p = 0; p < own.size(); ++p) EXPECT_EQ(own[p], p);
}

// Facets of a ball are gathered; those of the floor, which are larger than a patch, and of a lamp are not.
TEST(Patches, GatherSmallFacetsThatTurnLittle) {
  std::vector<TestSurface> surfaces{
      bumpyBall(2000, {0, 0, 1.2}), bumpyBall(2000, {3, 0, 1.2}), {"floor", {{{-2, -2, 0}, {6, -2, 0}, {6, 2, 0}, {-2, 2, 0}}}}};
  surfaces[1].name = "lamp";
  surfaces[1].emission = Rgb(1);
  // One half of the ball is another surface.
  std::vector<std::vector<Vec3>> half(surfaces[0].polygons.begin() + static_cast<std::ptrdiff_t>(surfaces[0].polygons.size() / 2),
                                      surfaces[0].polygons.end());
  surfaces[0].polygons.resize(surfaces[0].polygons.size() - half.size());
  surfaces.push_back({"half", std::move(half)});
  PatchOptions options{1, 0.4};
  const Cut single(loadSurfaces(surfaces), options);
  options.cluster = 15;
  const Cut gathered(loadSurfaces(surfaces), options);
  EXPECT_NEAR(areaOf(gathered), areaOf(single), 1e-9);
  const auto of = [](const Cut& cut, uint32_t surface) {
    return static_cast<size_t>(std::count_if(cut.patches.patches.begin(), cut.patches.patches.end(),
                                             [&](const Patch& p) { return p.surface == surface; }));
  };
  EXPECT_LT(of(gathered, 0) + of(gathered, 3), (of(single, 0) + of(single, 3)) / 4);
  EXPECT_EQ(of(gathered, 1), of(single, 1));
  EXPECT_EQ(of(gathered, 2), of(single, 2));
  for (uint32_t p = 0; p < gathered.patches.size(); ++p) {
    const Patch& patch = gathered.patches.patches[p];
    EXPECT_NEAR(glm::length(patch.normal), 1, 1e-12);
    double area = 0;
    for (const uint32_t c : gathered.patches.cellsOf(p)) {
      const Facet& facet = gathered.facets.facets[gathered.patches.cells[c].facet];
      const Facet& seed = gathered.facets.facets[gathered.patches.cells[gathered.patches.cellsOf(p)[0]].facet];
      EXPECT_GE(glm::dot(facet.normal, seed.normal), std::cos(15 * kPi / 180) - 1e-12);
      EXPECT_EQ(facet.surface, patch.surface);
      area += cellArea(gathered.facets, gathered.patches.grids[gathered.patches.cells[c].facet], gathered.patches.cells[c].facet);
    }
    EXPECT_NEAR(area, patch.area, 1e-9);
    if (gathered.patches.cellsOf(p).size() > 1) {
      EXPECT_LE(patch.area, 0.16 * (1 + 1e-9));
    }
  }
}

}  // namespace
}  // namespace farol::test
