// Mirrors and glass against the method of images and the Fresnel equations (truth, group C).
#include "specular_cases.h"
#include "trace/ray_tree.h"

#include <cmath>
#include <gtest/gtest.h>

namespace farol::test {
namespace {

TEST(Fresnel, HasTheKnownValues) {
  double through = 0;
  EXPECT_NEAR(fresnel(1, 1.5, through), 0.04, 1e-15);
  EXPECT_NEAR(through, 1, 1e-15);
  EXPECT_EQ(fresnel(0.5, 1 / 1.5, through), 1);  // beyond the critical angle of 41.8 degrees
  EXPECT_NEAR(fresnel(std::cos(std::atan(1.5)), 1.5, through), 0.5 * std::pow((1.5 * 1.5 - 1) / (1.5 * 1.5 + 1), 2), 1e-12);
  // Diffuse light: the mean over the cosine's distribution.
  for (const auto& [id, ior] : {std::pair{"C6a", 1.5}, std::pair{"C6b", 1.33}}) {
    constexpr int n = 100000;
    double mean = 0;
    for (int k = 0; k < n; ++k) mean += fresnel(std::sqrt((k + 0.5) / n), ior, through) / n;
    EXPECT_NEAR(mean, expected(id, "diffuse external reflectance rho_e"), 1e-6);
  }
}

TEST(RayTrees, MatchTheMethodOfImages) {
  for (const SpecularCase& c : kFactors) {
    RayRun run(loadSurfaces(surfacesOf(c.id)), {100, 0}, {.rays = 4096});
    run.makeAll();
    const double exact = expected(c.id, c.what), f = run.factor(c.from, c.to);
    const ErrorModel model = run.errorModel();
    double cut = 0;
    for (const uint32_t i : run.patchesOf(c.from)) cut = std::max(cut, run.f.shares(i).cut);
    EXPECT_NEAR(f, exact, 0.005 * exact + 3 * run.factorError(model, c.from, c.to) + cut) << c.id;
    EXPECT_LT(cut, 2e-4) << c.id;
    expectAccounted(run, c.id);
  }
}

// The error falls with samples as the method's law says.
TEST(RayTrees, ErrorFallsWithSamples) {
  const auto rms = [](uint32_t rays) {
    double sum = 0;
    for (uint64_t seed = 1; seed <= 16; ++seed) {
      RayRun run(loadSurfaces(surfacesOf("C2a")), {1, 0}, {.rays = rays, .seed = seed});
      const double d = run.factor("1", "2") - expected("C2a", "F12 extended");
      sum += d * d / 16;
    }
    return std::sqrt(sum);
  };
  const double slope = std::log(rms(256) / rms(16384)) / std::log(64.0);
  EXPECT_GT(slope, 0.55);
}

TEST(RayTrees, AreCutAtTheDepthAskedFor) {
  for (const int depth : {0, 1, 2, 4, 8}) {
    RayOptions options{.rays = depth < 2 ? 1u << 20 : 1u << 17};
    options.limits = {static_cast<uint32_t>(depth), 0};
    RayRun run(loadSurfaces(surfacesOf("C2a")), {1, 0}, options);
    const double exact = expected("C2a", "F12 with at most " + std::to_string(depth) + " bounces");
    EXPECT_NEAR(run.factor("1", "2"), exact, 0.002 * exact) << depth;
    expectAccounted(run, "depth");
  }
  for (const int depth : {8, 32}) {
    RayOptions options{.rays = 65536};
    options.limits = {static_cast<uint32_t>(depth), 0};
    RayRun run(loadSurfaces(surfacesOf("C4c")), {1, 0}, options);
    const double exact = expected("C4c", "transmission with at most " + std::to_string(depth) + " bounces");
    EXPECT_NEAR(run.factor("1", "2"), exact, 0.003 * exact) << depth;
  }
}

// Clear slabs: unpolarised Fresnel averaged at every face. With polarisation kept 0.8509 would pass at n = 1.5: that is
// the model's known difference.
TEST(RayTrees, PassDiffuseLightThroughSlabs) {
  for (const char* id : {"C6a", "C6b"}) {
    RayRun run(loadSurfaces(surfacesOf(id)), {1, 0}, {.rays = 65536});
    const double exact = expected(id, "slab transmittance if the two polarisations are averaged at every face (usual in graphics)");
    EXPECT_NEAR(run.factor("emitter", "receiver"), exact, 0.002 * exact) << id;
    EXPECT_NEAR(run.factor("emitter", "emitter"), 1 - exact, 0.002) << id;
    RayRun all(loadSurfaces(surfacesOf(id)), {1, 0}, {.rays = 1024});
    all.makeAll();
    expectAccounted(all, id);
    for (uint32_t i = 0; i < all.patches.size(); ++i) EXPECT_LT(all.f.shares(i).missed, 1e-3);
  }
}

// The same slab attenuates: the shares add up, and what passes straight is Beer's law.
TEST(RayTrees, AttenuateInSolids) {
  auto surfaces = surfacesOf("C6a");
  for (TestSurface& s : surfaces) {
    if (s.solid) {
      s.ior = 1.0 + 1e-9;  // straight through
      s.attenuationDistance = 0.1;
    }
  }
  RayRun run(loadSurfaces(surfaces), {1, 0}, {.rays = 65536});
  // Diffuse light through a layer of optical depth ln 10: 2 E3(ln 10), by Simpson's rule over the cosine.
  double exact = 0;
  constexpr int n = 20000;
  for (int k = 0; k < n; ++k) {
    const double mu = (k + 0.5) / n;
    exact += 2 * mu * std::exp(-std::log(10.0) / mu) / n;
  }
  EXPECT_NEAR(run.factor("emitter", "receiver"), exact, 0.01 * exact);
  run.makeAll();
  expectAccounted(run, "attenuation");
}

// Cubes with mirrors among their faces: diffuse and specular parts on one surface, mirrors facing each other.
TEST(MirrorCubes, MatchTheExactSystems) {
  for (const char* id : {"C5a", "C5b", "C5c"}) {
    RayRun run(loadSurfaces(surfacesOf(id)), {6, 0}, {.rays = 65536});
    run.makeAll();
    expectKnownRadiosity(run, id, 0.003);
  }
  RayRun run(loadSurfaces(surfacesOf("C5b")), {6, 0}, {.rays = 65536});
  for (const auto& [from, to, what] :
       {std::tuple{"x0", "x1", "F x0->x1 extended"}, std::tuple{"x0", "y0", "F x0->y0 extended"},
        std::tuple{"z0", "z0", "F z0->z0 extended (floor sees itself)"}, std::tuple{"z0", "x0", "F z0->x0 extended"}}) {
    const double exact = expected("C5b", what);
    EXPECT_NEAR(run.factor(from, to), exact, 0.005 * exact) << what;
  }
}

// What leaves a room of mirrors and glass without end is bounded in time and said.
TEST(RayTrees, EndWhereTheyNeverWould) {
  // Two perfect mirrors facing each other.
  auto pipe = surfacesOf("C4c");
  for (TestSurface& s : pipe) {
    if (maxChannel(s.mirror) > 0) s.mirror = Rgb(1);
  }
  RayRun mirrors(loadSurfaces(pipe), {1, 0}, {.rays = 1024});
  EXPECT_NEAR(mirrors.factor("1", "2"), 1, 0.01);
  // A closed room that is all mirror but for its floor, and a sphere of glass in it.
  auto room = closedBox({2, 2, 2}, Rgb(0));
  for (size_t k = 0; k < 6; ++k) {
    if (room[k].name != "z0") room[k].mirror = Rgb(1);
  }
  auto ball = sphereZones("ball", 0.5, false, {-1, 1}, 12, {1, 1, 1})[0];
  ball.reflectance = Rgb(0);
  ball.transmission = Rgb(1);
  ball.solid = true;
  room.push_back(ball);
  RayRun glass(loadSurfaces(room), {24, 0}, {.rays = 256});
  glass.makeAll();
  expectAccounted(glass, "glass in mirrors");
  for (uint32_t i = 0; i < glass.patches.size(); ++i) EXPECT_LT(glass.f.shares(i).missed, 1e-3) << i;
}

// Reciprocity: A_i F_ij = A_j F_ji holds for mirrors and clear glass too.
TEST(RayTrees, KeepReciprocity) {
  for (const char* id : {"C5b", "C3a"}) {
    RayRun run(loadSurfaces(surfacesOf(id)), {1, 0}, {.rays = 65536});
    run.makeAll();
    for (uint32_t i = 0; i < run.patches.size(); ++i) {
      for (uint32_t j = 0; j < i; ++j) {
        const double ij = run.patches.patches[i].area * run.f[i].at(j), ji = run.patches.patches[j].area * run.f[j].at(i);
        EXPECT_NEAR(ij, ji, 0.01 * std::max(ij, ji) + 1e-4) << id << " " << i << " " << j;
      }
    }
  }
}

// A patch behind a mirror, and a mirror that coincides with a wall.
TEST(RayTrees, SeeMirrorsFromTheirFrontOnly) {
  auto room = closedBox({2, 2, 2}, Rgb(0.5));
  room.push_back({"mirror", {{{0.5, 1, 0.5}, {0.5, 1, 1.5}, {1.5, 1, 1.5}, {1.5, 1, 0.5}}}, Rgb(0)});  // faces y = 0 or 2
  room.back().mirror = Rgb(1);
  const Scene scene = loadSurfaces(room);
  RayRun run(scene, {400, 0}, {.rays = 1024});
  run.makeAll();
  expectAccounted(run, "behind");
  const Vec3 n = run.patches.patches[run.patchesOf("mirror")[0]].normal;
  const char *front = n.y > 0 ? "y1" : "y0", *behind = n.y > 0 ? "y0" : "y1";
  double seenFront = 0, seenBehind = 0;
  for (const uint32_t i : run.patchesOf(front)) seenFront += run.f.shares(i).specular;
  for (const uint32_t i : run.patchesOf(behind)) seenBehind += run.f.shares(i).specular;
  EXPECT_GT(seenFront, 1);
  EXPECT_EQ(seenBehind, 0);
}

}  // namespace
}  // namespace farol::test
