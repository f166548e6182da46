// Raster and rays combined, against the method of images, against rays, and against raster where nothing is specular.
#include "formfactor/comparison.h"
#include "raster_run.h"
#include "specular_cases.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

struct HybridRun : RasterRun {
  HybridRun(const Scene& s, const PatchOptions& patchOptions, const RasterOptions& rasterOptions)
      : RasterRun(s, patchOptions, rasterOptions), tracer(facets), tree(tracer, facets, patches, {}) {
    options.tree = &tree;
  }
  Tracer tracer;
  RayTree tree;
};

RasterOptions fine() {
  RasterOptions o;
  o.resolution = 128;
  o.positions = 16;
  return o;
}

TEST(Hybrid, MatchesTheMethodOfImages) {
  for (const SpecularCase& c : kFactors) {
    HybridRun run(loadSurfaces(surfacesOf(c.id)), {16, 0}, fine());
    const double exact = expected(c.id, c.what), f = run.factor(c.from, c.to);
    double cut = 0;
    for (const uint32_t i : run.patchesOf(c.from)) cut = std::max(cut, run.f.shares(i).cut);
    EXPECT_NEAR(f, exact, 0.005 * exact + cut) << c.id;
    EXPECT_LT(cut, 2e-4) << c.id;
    expectAccounted(run, c.id);
  }
}

TEST(Hybrid, PassesDiffuseLightThroughSlabs) {
  RasterOptions o;
  o.positions = 16;
  for (const char* id : {"C6a", "C6b"}) {
    HybridRun run(loadSurfaces(surfacesOf(id)), {1, 0}, o);
    const double exact = expected(id, "slab transmittance if the two polarisations are averaged at every face (usual in graphics)");
    EXPECT_NEAR(run.factor("emitter", "receiver"), exact, 0.002 * exact) << id;
  }
}

TEST(Hybrid, MatchesTheExactMirrorCubes) {
  RasterOptions o = fine();
  o.positions = 64;
  for (const char* id : {"C5a", "C5b", "C5c"}) {
    HybridRun run(loadSurfaces(surfacesOf(id)), {6, 0}, o);
    run.makeAll();
    expectKnownRadiosity(run, id, 0.003);
  }
}

std::vector<TestSurface> mirrorRoom(double s) {
  auto room = closedBox({2, 3, 2.5}, Rgb(0.5));
  room.push_back({"mirror", {{{0.5, 2.9, 0.5}, {1.5, 2.9, 0.5}, {1.5, 2.9, 1.5}, {0.5, 2.9, 1.5}}}, Rgb(0.1)});  // faces y = 0
  room.back().mirror = Rgb(s);
  return room;
}

// Exactly the raster row where no mirror is seen, and everywhere when there is none.
TEST(Hybrid, IsRasterWhereNothingIsSpecular) {
  for (const double s : {0.0, 0.9}) {
    for (const int positions : {1, 4}) {
      RasterOptions o;
      o.positions = positions;
      const Scene scene = loadSurfaces(mirrorRoom(s));
      HybridRun hybrid(scene, {300, 0}, o);
      RasterRun raster(scene, {300, 0}, o);
      hybrid.makeAll();
      raster.makeAll();
      size_t same = 0;
      for (uint32_t i = 0; i < raster.patches.size(); ++i) {
        if (hybrid.f.shares(i).specular > 0) continue;
        EXPECT_EQ(hybrid.f[i].expanded(), raster.f[i].expanded()) << i;
        ++same;
      }
      EXPECT_GT(same, s == 0 ? raster.patches.size() - 1 : 10u);
      EXPECT_LT(same, s == 0 ? raster.patches.size() + 1 : raster.patches.size());
    }
  }
}

// Rows do not depend on where batches end, also when a patch's positions are cut by one.
TEST(Hybrid, DoesNotDependOnBatches) {
  const Scene scene = loadSurfaces(mirrorRoom(0.9));
  RasterOptions o;
  o.positions = 4;
  HybridRun whole(scene, {100, 0}, o);
  o.maxBatch = 7;
  HybridRun parts(scene, {100, 0}, o);
  whole.makeAll();
  parts.makeAll();
  for (uint32_t i = 0; i < whole.patches.size(); ++i) {
    const auto a = whole.f[i].expanded(), b = parts.f[i].expanded();
    for (size_t j = 0; j < a.size(); ++j) EXPECT_NEAR(a[j], b[j], 1e-7) << i;
  }
}

TEST(Hybrid, AgreesWithRaysWithTheNearFieldOn) {
  const Scene scene = loadSurfaces(mirrorRoom(0.9));
  RayRun rays(scene, {500, 0}, {.rays = 4096});
  rays.makeAll();
  HybridRun hybrid(scene, {500, 0}, {});
  const ExposedArea exposed = findExposedArea(rays.tracer, hybrid.facets, hybrid.patches, 64, 1);
  const NearField nearField(rays.tracer, hybrid.facets, hybrid.patches, exposed, 1);
  hybrid.options.nearField = &nearField;
  hybrid.options.exposed = &exposed;
  hybrid.makeAll();
  expectAccounted(hybrid, "near field");
  ProbeRows probes;
  probes.patches = chooseProbes(hybrid.patches, 128);
  RayRun better(scene, {500, 0}, {.rays = 65536, .seed = 5});
  probes.reference.emplace_back(hybrid.patches.size());
  better.maker()->makeRows(probes.patches, probes.reference[0], [](size_t) {});
  const Comparison c = compareFactors(rays.f, rays.errorModel(), hybrid.f,
                                      fitErrorModel(hybrid.f, hybrid.patches, probes, 3 * 64 * 64), hybrid.patches);
  EXPECT_GT(c.withinEstimate, 0.95);
}

// Pixels much larger than patches: the near field finds patches of a mirror that no pixel shows, and nothing goes on from there.
TEST(Hybrid, AccountsForMirrorsThatNoPixelShows) {
  const Scene scene = loadSurfaces(mirrorRoom(0.9));
  RayRun rays(scene, {1500, 0}, {});
  RasterOptions few;
  few.resolution = 8;
  HybridRun hybrid(scene, {1500, 0}, few);
  const ExposedArea exposed = findExposedArea(rays.tracer, hybrid.facets, hybrid.patches, 64, 1);
  const NearField nearField(rays.tracer, hybrid.facets, hybrid.patches, exposed, 1);
  hybrid.options.nearField = &nearField;
  hybrid.makeAll();
  expectAccounted(hybrid, "few pixels");
}

}  // namespace
}  // namespace farol::test
