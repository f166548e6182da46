// What raster and rays owe each other: the near field keeps row sums, covered area counts for neither, a fault in one of
// them is found by comparing.
#include "formfactor/comparison.h"
#include "raster_run.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

// A room with an open box (no bottom) standing on its floor.
std::vector<TestSurface> roomWithBlock() {
  auto surfaces = closedBox({2, 3, 2.5}, Rgb(0.5), Rgb(1));
  TestSurface block{"block", {}, Rgb(0.5), Rgb(1)};
  const Vec3 base[4] = {{0.53, 0.71, 0}, {1.23, 0.93, 0}, {1.01, 1.63, 0}, {0.31, 1.41, 0}};
  const Vec3 up(0, 0, 0.8);
  block.polygons.push_back({base[0] + up, base[1] + up, base[2] + up, base[3] + up});
  for (int k = 0; k < 4; ++k) block.polygons.push_back({base[k], base[(k + 1) % 4], base[(k + 1) % 4] + up, base[k] + up});
  surfaces.push_back(block);
  return surfaces;
}
constexpr double kFootprint = 0.7 * 0.7 + 0.22 * 0.22;  // a square, turned

RasterRun corrected(const Scene& scene, size_t patches, RayRun& rays, std::unique_ptr<ExposedArea>& exposed,
                    std::unique_ptr<NearField>& nearField) {
  RasterRun run(scene, {patches, 0}, {});
  exposed = std::make_unique<ExposedArea>(findExposedArea(rays.tracer, run.facets, run.patches, 64, 1));
  nearField = std::make_unique<NearField>(rays.tracer, run.facets, run.patches, *exposed, 1);
  run.options.exposed = exposed.get();
  run.options.nearField = nearField.get();
  return run;
}

TEST(NearField, NeverChangesARowSum) {
  const Scene scene = loadSurfaces(roomWithBlock());
  RayRun rays(scene, {800, 0}, {});
  std::unique_ptr<ExposedArea> exposed;
  std::unique_ptr<NearField> nearField;
  RasterRun with = corrected(scene, 800, rays, exposed, nearField), without(scene, {800, 0}, {});
  without.options.exposed = exposed.get();
  with.makeAll();
  without.makeAll();
  size_t changed = 0;
  for (uint32_t i = 0; i < with.patches.size(); ++i) {
    EXPECT_NEAR(with.f.rowSum(i), without.f.rowSum(i), 1e-6) << i;
    if (with.f.shares(i).correction != 1) ++changed;
  }
  EXPECT_GT(changed, with.patches.size() / 2);
}

// In the open what leaves the scene makes up for it; in a box of six patches nothing is far, and near entries divide
// their sum as the closed forms do (truth A1a and A12b).
TEST(NearField, HasSomethingToBalanceItInOpenScenesAndSmallOnes) {
  const auto corrected = [](const std::vector<TestSurface>& surfaces) {
    const Scene scene = loadSurfaces(surfaces);
    RayRun rays(scene, {0, 100}, {});
    const ExposedArea exposed = findExposedArea(rays.tracer, rays.facets, rays.patches, 64, 1);
    const NearField nearField(rays.tracer, rays.facets, rays.patches, exposed, 1);
    RasterRun run(scene, {0, 100}, {});
    run.options.nearField = &nearField;
    run.makeAll();
    return run;
  };
  RasterRun plates =
      corrected({{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}, {"2", {{{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}}}}});
  EXPECT_NEAR(plates.factor("1", "2"), 0.1998248957, 1e-5);
  EXPECT_NEAR(plates.f.rowSum(0) + plates.f.shares(0).missed, 1, 1e-6);
  RasterRun box = corrected(closedBox({1, 2, 3}));
  EXPECT_NEAR(box.f.rowSum(0), 1, 1e-6);
  EXPECT_NEAR(box.factor("x0", "y0"), 0.1594983507, 5e-4);
  EXPECT_NEAR(box.factor("x0", "x1"), 0.4755764365, 5e-4);
}

// Pixels much larger than patches: those near an edge that show no pixel count as much as those that do. The mean factor
// between two sides of a cube is a closed form (truth A12a).
TEST(NearField, DoesNotDependOnWhatPixelsShow) {
  const Scene scene = loadSurfaces(closedBox({1, 1, 1}));
  RayRun rays(scene, {1500, 0}, {});
  std::unique_ptr<ExposedArea> exposed;
  std::unique_ptr<NearField> nearField;
  const auto made = [&](bool lists) {
    RasterRun run = corrected(scene, 1500, rays, exposed, nearField);
    run.options.resolution = 8;
    run.options.lists = lists;
    run.makeAll();
    return run;
  };
  RasterRun listed = made(true), dense = made(false);
  EXPECT_NEAR(dense.factor("x0", "y0"), 0.2000437771, 0.005 * 0.2);
  EXPECT_NEAR(dense.factor("x0", "x1"), 0.1998248957, 0.01 * 0.2);
  // To the patches along an edge from the rows that touch it.
  const UnoccludedFactor exact(dense.facets, dense.patches);
  double found = 0, expected = 0;
  for (const uint32_t i : dense.patchesOf("x0")) {
    if (dense.patches.patches[i].centre.y > 0.1) continue;
    for (const uint32_t j : dense.patchesOf("y0")) {
      if (dense.patches.patches[j].centre.x > 0.1) continue;
      found += dense.f[i].at(j);
      expected += exact(i, j);
    }
  }
  EXPECT_NEAR(found, expected, 0.003 * expected);
  for (uint32_t i = 0; i < dense.patches.size(); ++i) {
    EXPECT_NEAR(dense.f.rowSum(i), 1, 1e-6);
    EXPECT_EQ(listed.f[i].expanded(), dense.f[i].expanded()) << i;
  }
}

// What stands on a floor hides the area under it from both ways of seeing: rows of partly covered patches still sum to
// one, and the exposed area is the floor's less the footprint.
TEST(CoveredArea, NeitherGathersNorIsSeen) {
  const Scene scene = loadSurfaces(roomWithBlock());
  for (const size_t count : {size_t{400}, size_t{1500}, size_t{6000}}) {
    RayRun rays(scene, {count, 0}, {.rays = 256});
    rays.makeAll();
    std::unique_ptr<ExposedArea> exposed;
    std::unique_ptr<NearField> nearField;
    RasterRun raster = corrected(scene, count, rays, exposed, nearField);
    raster.makeAll();
    for (const FactorRun* run : {static_cast<const FactorRun*>(&rays), static_cast<const FactorRun*>(&raster)}) {
      double floor = 0, sent = 0, gathered = 0;
      for (const uint32_t i : run->patchesOf("z0")) {
        const double area = run->patches.patches[i].area * run->f.shares(i).exposed;
        floor += area;
        gathered += area * run->f.rowSum(i);
        const RowShares& shares = run->f.shares(i);
        if (shares.exposed > 0) {
          EXPECT_NEAR(run->f.rowSum(i) + shares.missed + shares.backs, 1, 1e-6);
        }
        EXPECT_LE(run->f.rowSum(i), 1 + 1e-6);
      }
      // What the others send to the floor is what it sends to them: nothing arrives on the covered part.
      for (uint32_t i = 0; i < run->patches.size(); ++i) {
        const Patch& p = run->patches.patches[i];
        double toFloor = 0;
        run->f[i].forEach(
            [&](size_t j, double f) { toFloor += surfaceNameOf(run->scene, run->patches.patches[j]) == "z0" ? f : 0; });
        sent += p.area * run->f.shares(i).exposed * toFloor;
      }
      EXPECT_NEAR(floor, 6 - kFootprint, 0.003 * 6) << count;
      EXPECT_NEAR(sent, gathered, 0.005 * gathered) << count;
    }
  }
}

TEST(Comparison, FindsAFacetThatWasMovedInOneOfTwo) {
  const Scene scene = loadSurfaces(roomWithBlock());
  RayRun rays(scene, {600, 0}, {.rays = 4096});
  rays.makeAll();
  const auto compared = [&](RasterRun& raster) {
    raster.makeAll();
    ProbeRows probes;
    probes.patches = chooseProbes(raster.patches, 256);
    probes.reference.emplace_back(raster.patches.size());
    RasterOptions better;  // of the same facets, so that their fault is not taken for sampling error
    better.resolution = 128;
    better.positions = 16;
    RasterRowMaker(device(), raster.facets, raster.patches, better).makeRows(probes.patches, probes.reference[0], [](size_t) {});
    return compareFactors(rays.f, rays.errorModel(), raster.f, fitErrorModel(raster.f, raster.patches, probes, 3 * 64 * 64),
                          raster.patches);
  };
  RasterOptions options;
  options.positions = 4;
  RasterRun good(scene, {600, 0}, options);
  EXPECT_GT(compared(good).withinEstimate, 0.95);

  RasterRun faulty(scene, {600, 0}, options);
  for (const Facet& f : faulty.facets.facets) {
    if (scene.surfaces[f.surface].name != "block" || f.normal.z < 0.9) continue;
    for (size_t k = 0; k < f.cornerCount(); ++k) faulty.facets.points[f.corners[k]].z += 0.05;  // the block's top
  }
  const Comparison c = compared(faulty);
  EXPECT_LT(c.withinEstimate, 0.95);
  const RowDifference& worst = c.rows[c.worst];
  const auto name = [&](uint32_t p) { return p == kNone ? "" : surfaceNameOf(scene, faulty.patches.patches[p]); };
  EXPECT_TRUE(name(c.worst) == "block" || name(worst.more) == "block" || name(worst.less) == "block")
      << name(c.worst) << " " << name(worst.more) << " " << name(worst.less);
}

}  // namespace
}  // namespace farol::test
