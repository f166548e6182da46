// Raster with planar mirrors, by images, against the method of images in closed form and against rays.
#include "formfactor/images.h"

#include "base/error.h"
#include "formfactor/comparison.h"
#include "raster_run.h"
#include "specular_cases.h"

#include <gmock/gmock.h>
#include <optional>

namespace farol::test {
namespace {

struct ImageRun : RasterRun {
  ImageRun(const Scene& s, const PatchOptions& patchOptions, const RasterOptions& rasterOptions, uint32_t maxImages = 256,
           const TreeLimits& limits = {})
      : RasterRun(s, patchOptions, rasterOptions), images(scene, facets, patches, limits, maxImages) {
    options.images = &images;
  }
  ImageTrees images;
};

RasterOptions positions(int count, uint32_t resolution = 64) {
  RasterOptions o;
  o.positions = count;
  o.resolution = resolution;
  return o;
}

TEST(Images, MatchTheMethodOfImages) {
  for (const SpecularCase& c : kFactors) {
    const bool fewImages = std::string(c.id) < "C2";
    ImageRun run(loadSurfaces(surfacesOf(c.id)), {1, 0}, positions(fewImages ? 100 : 36, fewImages ? 128 : 64));
    const double exact = expected(c.id, c.what), f = run.factor(c.from, c.to);
    const double cut = run.f.shares(run.patchesOf(c.from)[0]).cut;
    // What is cut would have reached the receiver at most.
    EXPECT_LT(f, 1.005 * exact + 1e-5) << c.id;
    EXPECT_GT(f, 0.995 * exact - cut - 1e-5) << c.id;
    expectAccounted(run, c.id);
    if (std::string(c.id) < "C4") {
      EXPECT_LT(cut, 1e-4) << c.id;
    }
  }
}

TEST(Images, AreCutAtTheDepthAskedFor) {
  for (const int depth : {0, 1, 2, 4}) {
    ImageRun run(loadSurfaces(surfacesOf("C2a")), {1, 0}, positions(36), 256, {static_cast<uint32_t>(depth), 0});
    const double exact = expected("C2a", "F12 with at most " + std::to_string(depth) + " bounces");
    EXPECT_NEAR(run.factor("1", "2"), exact, 0.003 * exact) << depth;
    expectAccounted(run, "depth");
  }
}

TEST(Images, MatchTheExactMirrorCubes) {
  for (const char* id : {"C5a", "C5b", "C5c"}) {
    ImageRun run(loadSurfaces(surfacesOf(id)), {6, 0}, positions(64));
    run.makeAll();
    expectKnownRadiosity(run, id, 0.004);
  }
}

// Truth C1b: emitter [0,1] x [0,1] and receiver [0.5,1.75] x [-0.5,0.25] share a part of their plane; here as the parts
// that lie apart, with the shared one in both.
TEST(Images, MatchWhereEmitterAndReceiverOverlap) {
  const auto rectangle = [](double x0, double y0, double x1, double y1) {
    return std::vector<std::vector<Vec3>>{{{x0, y0, 0}, {x1, y0, 0}, {x1, y1, 0}, {x0, y1, 0}}};
  };
  std::vector<TestSurface> surfaces = {{"e1", rectangle(0, 0, 0.5, 1), Rgb(0)},        {"e2", rectangle(0.5, 0.25, 1, 1), Rgb(0)},
                                       {"both", rectangle(0.5, 0, 1, 0.25), Rgb(0)},   {"r1", rectangle(0.5, -0.5, 1, 0), Rgb(0)},
                                       {"r2", rectangle(1, -0.5, 1.75, 0.25), Rgb(0)}, surfacesOf("C1b").back()};
  const Scene scene = loadSurfaces(surfaces);
  const double exact = expected("C1b", "F12 extended (through the mirror)");
  const auto factor = [](FactorRun& run) {
    double sum = 0;
    for (const auto& [from, area] : {std::pair{"e1", 0.5}, std::pair{"e2", 0.375}, std::pair{"both", 0.125}}) {
      for (const char* to : {"both", "r1", "r2"}) sum += area * run.factor(from, to);
    }
    return sum;  // over the emitter's area, 1
  };
  const PatchOptions patches{0, 0.25};
  RayRun rays(scene, patches, {.rays = 16384});
  RasterRun hybrid(scene, patches, positions(16));
  const RayTree tree(rays.tracer, hybrid.facets, hybrid.patches, {});
  hybrid.options.tree = &tree;
  ImageRun images(scene, patches, positions(16));
  EXPECT_NEAR(factor(rays), exact, 0.005 * exact);
  EXPECT_NEAR(factor(hybrid), exact, 0.005 * exact);
  EXPECT_NEAR(factor(images), exact, 0.005 * exact);
}

// A corner of mirrors: four images at most, the one through both counted once; nothing behind a mirror is seen in it.
TEST(Images, AreAsManyAsThereAre) {
  ImageRun run(loadSurfaces(surfacesOf("C3a")), {1, 0}, positions(1));
  const Vec3 normal(0, 0, 1), centre = run.facets.frame.toUnit(run.patches.patches[run.patchesOf("1")[0]].centre);
  const HemicubePose pose{centre, {1, 0, 0}, {0, 1, 0}, normal};
  EXPECT_EQ(run.images.of(pose).size(), 4u);  // x, y, x then y, y then x
  for (const MirrorImage& image : run.images.of(pose)) {
    EXPECT_LT(glm::dot(image.clipNormal, image.pose.origin), image.clipDistance);
    EXPECT_EQ(image.flipped, image.parent < 0);
  }
}

std::vector<TestSurface> roomWithMirrors() {
  auto room = closedBox({2, 3, 2.5}, Rgb(0.5));
  room.push_back({"mirror", {{{0.5, 2.9, 0.5}, {1.5, 2.9, 0.5}, {1.5, 2.9, 1.5}, {0.5, 2.9, 1.5}}}, Rgb(0.1)});  // faces y = 0
  room.back().mirror = Rgb(0.8);
  room.push_back({"other", {{{0.3, 0.1, 0.3}, {0.3, 0.1, 2}, {1.7, 0.1, 2}, {1.7, 0.1, 0.3}}}, Rgb(0)});  // faces y = 3
  room.back().mirror = Rgb(0.6);
  return room;
}

// Few or many hemicubes per batch, layered or not: the same rows. Near-field corrections keep every share accounted for.
TEST(Images, DoNotDependOnBatchesAndAgreeWithRays) {
  const Scene scene = loadSurfaces(roomWithMirrors());
  RayRun rays(scene, {300, 0}, {.rays = 4096});
  rays.makeAll();
  ImageRun whole(scene, {300, 0}, {}, 12);
  const ExposedArea exposed = findExposedArea(rays.tracer, whole.facets, whole.patches, 64, 1);
  const NearField nearField(rays.tracer, whole.facets, whole.patches, exposed, 1);
  const auto corrected = [&](ImageRun& run) {
    run.options.nearField = &nearField;
    run.options.exposed = &exposed;
    run.makeAll();
  };
  corrected(whole);
  expectAccounted(whole, "near field");
  ImageRun small(scene, {300, 0}, {}, 12), single(scene, {300, 0}, {}, 12);
  small.options.maxBatch = 16;
  single.options.layered = false;
  corrected(small);
  corrected(single);
  for (uint32_t i = 0; i < whole.patches.size(); ++i) {
    EXPECT_EQ(whole.f[i].expanded(), small.f[i].expanded()) << i;
    EXPECT_EQ(whole.f[i].expanded(), single.f[i].expanded()) << i;
  }
  ProbeRows probes;
  probes.patches = chooseProbes(whole.patches, 128);
  RayRun better(scene, {300, 0}, {.rays = 65536, .seed = 5});
  probes.reference.emplace_back(whole.patches.size());
  better.maker()->makeRows(probes.patches, probes.reference[0], [](size_t) {});
  const Comparison c =
      compareFactors(rays.f, rays.errorModel(), whole.f, fitErrorModel(whole.f, whole.patches, probes, 3 * 64 * 64), whole.patches);
  EXPECT_GT(c.withinEstimate, 0.95);
}

// A mirror in the very plane of a wall, a mirror whose plane holds the eyes of many hemicubes, and a sphere of mirrors:
// bounded, every share accounted for, nothing lost through the seams, by all methods that can.
TEST(AwkwardMirrors, LoseNothing) {
  const auto room = [] { return closedBox({2, 2, 2}, Rgb(0.5)); };
  auto coincident = room(), edgeOn = room(), ball = room();
  coincident.push_back({"mirror", {{{0, 0.5, 0.5}, {0, 1.5, 0.5}, {0, 1.5, 1.5}, {0, 0.5, 1.5}}}, Rgb(0)});
  edgeOn.push_back({"mirror", {{{1, 0.5, 0.5}, {1, 1.5, 0.5}, {1, 1.5, 1.5}, {1, 0.5, 1.5}}}, Rgb(0)});
  ball.push_back(sphereZones("ball", 0.5, false, {-1, 1}, 12, {1, 1, 1})[0]);
  ball.back().reflectance = Rgb(0);
  for (auto* surfaces : {&coincident, &edgeOn, &ball}) {
    surfaces->back().mirror = Rgb(1);
    const Scene scene = loadSurfaces(*surfaces);
    const bool planar = surfaces != &ball;
    RayRun rays(scene, {150, 0}, {.rays = 1024});
    RasterRun hybrid(scene, {150, 0}, {});
    const RayTree tree(rays.tracer, hybrid.facets, hybrid.patches, {});
    hybrid.options.tree = &tree;
    std::vector<FactorRun*> runs = {&rays, &hybrid};
    std::optional<ImageRun> images;
    if (planar) runs.push_back(&images.emplace(scene, PatchOptions{150, 0}, RasterOptions{}));
    for (FactorRun* run : runs) {
      run->makeAll();
      expectAccounted(*run, "awkward");
      double missed = 0, cut = 0;
      for (uint32_t i = 0; i < run->patches.size(); ++i) {
        missed += run->f.shares(i).missed / static_cast<double>(run->patches.size());
        cut = std::max(cut, run->f.shares(i).cut);
      }
      EXPECT_LT(missed, 1e-3);
      EXPECT_LT(cut, 0.01);
    }
  }
}

TEST(Images, AreRefusedWhereMirrorsAreNotPlanar) {
  const auto expectRefused = [](const std::vector<TestSurface>& surfaces, const std::string& sentence) {
    try {
      ImageRun run(loadSurfaces(surfaces), {200, 0}, {});
      ADD_FAILURE() << "not refused: " << sentence;
    } catch (const Error& e) {
      EXPECT_THAT(e.what(), ::testing::HasSubstr(sentence));
    }
  };
  auto room = closedBox({2, 2, 2}, Rgb(0.5));
  room.push_back(sphereZones("ball", 0.5, false, {-1, 1}, 16, {1, 1, 1})[0]);
  room.back().reflectance = Rgb(0);
  room.back().mirror = Rgb(0.9);
  expectRefused(room, "surface 'ball' is a curved mirror, which --method raster cannot mirror; use rays or hybrid");
  room.back().mirror = Rgb(0);
  room.back().transmission = Rgb(0.9);
  expectRefused(room, "surface 'ball' is clear glass");
}

}  // namespace
}  // namespace farol::test
