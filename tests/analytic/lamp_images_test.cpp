// Lamps in planar mirrors, against closed forms of their images and against rows that count every path.
#include "light/lamp_images.h"

#include "factor_run.h"
#include "formfactor/analytic.h"
#include "light/direct.h"
#include "patch/positions.h"
#include "specular_cases.h"

#include <gtest/gtest.h>

namespace farol::test {
namespace {

constexpr double kLampEmission = 100;

TestSurface lampOver(double x0, double x1, double y0, double y1, double z) {
  return {"lamp", {{{x0, y0, z}, {x0, y1, z}, {x1, y1, z}, {x1, y0, z}}}, Rgb(0), Rgb(kLampEmission)};  // faces down
}

// A lamp below the ceiling of a room of 4 x 3 x 2.7.
std::vector<TestSurface> room() {
  std::vector<TestSurface> surfaces = closedBox({4, 3, 2.7}, Rgb(0.05));
  surfaces.push_back(lampOver(1.2, 1.8, 1.0, 1.4, 2.6));
  return surfaces;
}

struct Lit {
  Lit(const std::vector<TestSurface>& surfaces, size_t patches, uint32_t shadowRays, const TreeLimits& limits = {})
      : run(loadSurfaces(surfaces), {patches, 0}, {}), mirrors(run.facets, run.patches) {
    lamps = chooseLamps(run.facets, run.patches, {}).lamps;
    images = lampImages(lamps, mirrors, limits);
    std::vector<Lamp> all = lamps;
    if (images) all.insert(all.end(), images->begin(), images->end());
    const DirectIrradiance light(run.tracer, run.facets, run.patches, all, {}, {shadowRays, 1, &mirrors});
    direct = light.compute(std::vector<double>(run.patches.size(), 1.0));
  }
  // Irradiance of a patch by a lamp that nothing hides [flux per area].
  double unoccluded(uint32_t patch, std::vector<Vec3> polygon, bool reflected) const {
    if (reflected) std::reverse(polygon.begin(), polygon.end());
    double sum = 0;
    for (const Position& p : positionsOn(run.facets, run.patches, patch, 64, 1))
      sum += p.weight * pointToPolygon(p.point, p.normal, polygon);
    return kLampEmission * sum;
  }
  double fluxOf(const std::string& surface) const {
    double sum = 0;
    for (const uint32_t i : run.patchesOf(surface)) sum += run.patches.patches[i].area * direct.irradiance[i].r;
    return sum;
  }

  RayRun run;
  PlanarMirrors mirrors;
  std::vector<Lamp> lamps;
  std::optional<std::vector<Lamp>> images;
  DirectLight direct;
};

// Two walls at right angles show a lamp three times. Which of the walls comes first on the way to the third image depends on the
// place; together they show all of it.
TEST(LampImages, ShineFromACornerOfMirrors) {
  std::vector<TestSurface> surfaces = room();
  const Rgb ofX(0.9, 0.8, 0.7), ofY(0.6, 0.7, 0.8);
  for (TestSurface& s : surfaces) {
    if (s.name == "x0") s.mirror = ofX;
    if (s.name == "y0") s.mirror = ofY;
  }
  const Lit lit(surfaces, 1500, 1024);
  ASSERT_TRUE(lit.images);
  EXPECT_EQ(lit.images->size(), 4u);
  ASSERT_EQ(lit.lamps.size(), 1u);
  const Vec3 corner = lit.run.facets.frame.toUnit(Vec3(0));
  const auto reflected = [&](std::vector<Vec3> polygon, bool x, bool y) {
    for (Vec3& v : polygon) v = {x ? 2 * corner.x - v.x : v.x, y ? 2 * corner.y - v.y : v.y, v.z};
    return polygon;
  };
  double squares = 0, told = 0, worst = 0;
  Rgb flux(0), exactFlux(0);
  for (const char* surface : {"z0", "x1", "y1"}) {
    for (const uint32_t i : lit.run.patchesOf(surface)) {
      if (lit.run.patches.patches[i].centre.z > 2.3) continue;  // beside the lamp, or behind it
      const std::vector<Vec3>& lamp = lit.lamps[0].polygon;
      const Rgb exact = lit.unoccluded(i, lamp, false) + ofX * lit.unoccluded(i, reflected(lamp, true, false), true) +
                        ofY * lit.unoccluded(i, reflected(lamp, false, true), true) +
                        ofX * ofY * lit.unoccluded(i, reflected(lamp, true, true), false);
      const Rgb error = lit.direct.irradiance[i] - exact;
      worst = std::max(worst, maxChannel(glm::abs(error)) / maxChannel(exact));
      squares += error.r * error.r;
      told += lit.direct.deviation[i].r * lit.direct.deviation[i].r;
      flux += lit.run.patches.patches[i].area * lit.direct.irradiance[i];
      exactFlux += lit.run.patches.patches[i].area * exact;
    }
  }
  EXPECT_LT(worst, 0.02);
  EXPECT_LT(squares, 4 * told);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(flux[c], exactFlux[c], 0.001 * exactFlux[c]);
}

// A screen that parts the room hides the mirror: what is left is the lamp itself.
TEST(LampImages, AreHiddenByWhatStandsBeforeTheMirror) {
  std::vector<TestSurface> surfaces = room();
  const Lit without(surfaces, 1000, 64);
  surfaces[0].mirror = Rgb(0.9);
  surfaces.push_back({"screen", {{{0.3, 0, 0}, {0.3, 3, 0}, {0.3, 3, 2.7}, {0.3, 0, 2.7}}}, Rgb(0), Rgb(0), true});
  const Lit lit(surfaces, 1000, 64);
  ASSERT_EQ(surfaces[0].name, "x0");
  EXPECT_EQ(lit.images->size(), 1u);
  EXPECT_NEAR(lit.fluxOf("x1"), without.fluxOf("x1"), 0.002 * without.fluxOf("x1"));
  for (const uint32_t i : lit.run.patchesOf("x0")) EXPECT_EQ(lit.direct.irradiance[i].r, 0);
}

// Every path counts once, where the mirror is small, a screen hides part of it, and the lamp reaches behind the mirror's plane.
TEST(LampImages, BringWhatRowsBring) {
  std::vector<TestSurface> surfaces = room();
  surfaces.push_back({"mirror", {{{1.4, 0.5, 0.4}, {1.4, 2.5, 0.4}, {1.4, 2.5, 2.2}, {1.4, 0.5, 2.2}}}, Rgb(0)});  // faces x1
  surfaces.back().mirror = Rgb(1);
  surfaces.push_back({"screen", {{{2, 0.2, 1.2}, {2, 1.5, 1.2}, {3, 1.5, 1.2}, {3, 0.2, 1.2}}}, Rgb(0), Rgb(0), true});
  const Lit lit(surfaces, 300, 1024);
  ASSERT_TRUE(lit.images);
  EXPECT_EQ(lit.images->size(), 1u);
  RayRun rows(loadSurfaces(surfaces), {300, 0}, {.rays = 1u << 18});
  const std::vector<uint32_t> lamp = rows.patchesOf("lamp");
  for (const char* surface : {"z0", "x1", "y0"}) {
    rows.makeRowsOf(surface);
    double flux = 0;
    for (const uint32_t i : rows.patchesOf(surface)) {
      for (const uint32_t j : lamp) flux += rows.patches.patches[i].area * static_cast<double>(rows.f[i].at(j)) * kLampEmission;
    }
    EXPECT_NEAR(lit.fluxOf(surface), flux, 0.005 * flux) << surface;
  }
}

TEST(LampImages, AreAsManyAsTheLimitsLeave) {
  std::vector<TestSurface> surfaces = room();
  surfaces[0].mirror = surfaces[1].mirror = Rgb(0.5);  // x0 and x1: two images of every depth
  const double half = 0.5;
  EXPECT_EQ(Lit(surfaces, 200, 16, {512, 0.9 * std::pow(half, 9)}).images->size(), 18u);
  EXPECT_EQ(Lit(surfaces, 200, 16, {3, 1e-4}).images->size(), 6u);
  surfaces[2].mirror = surfaces[3].mirror = surfaces[1].mirror = surfaces[0].mirror = Rgb(0.95);
  EXPECT_FALSE(Lit(surfaces, 200, 16).images);  // a pipe
  surfaces = room();
  surfaces[0].mirror = Rgb(0.5);
  surfaces.push_back({"pane", {{{2, 1, 1}, {3, 1, 1}, {3, 2, 1}, {2, 2, 1}}}, Rgb(0), Rgb(0), true, Rgb(0), Rgb(1)});
  EXPECT_FALSE(Lit(surfaces, 200, 16).images);  // light passes it
  surfaces = room();
  surfaces.push_back(bumpyBall(1500, {2.5, 1.5, 1.2}));
  surfaces.back().reflectance = Rgb(0);
  surfaces.back().mirror = Rgb(0.9);
  const Lit ball(surfaces, 200, 16);  // a mirror per facet
  EXPECT_TRUE(ball.mirrors.tooMany());
  EXPECT_FALSE(lampImages(ball.lamps, ball.mirrors, {1, 1e-4}, size_t{1} << 20)) << "some facets are not among the mirrors";
}

// From the middle of a room whose walls x0 and y0 are mirrors, to images and to what is none.
TEST(PlanarMirrors, ConnectOverTheMirrorsNamedOnly) {
  std::vector<TestSurface> surfaces = closedBox({4, 3, 2.7}, Rgb(0.05));
  surfaces[0].mirror = Rgb(0.9);
  surfaces[2].mirror = Rgb(0.8);
  const RayRun run(loadSurfaces(surfaces), {100, 0}, {});
  const PlanarMirrors mirrors(run.facets, run.patches);
  ASSERT_EQ(mirrors.all().size(), 2u);
  const uint32_t x = mirrors.all()[0].normal.x > 0.5 ? 0 : 1, y = 1 - x;
  const auto connects = [&](const Vec3& to, const std::vector<uint32_t>& way) {
    const Vec3 from = run.facets.frame.toUnit(Vec3(2, 1, 1.5));
    RayPacket rays;
    for (uint32_t k = 0; k < kPacketSize; ++k) rays.set(k, from, Vec3(0, 0, 1e-30));
    rays.set(5, from, run.facets.frame.toUnit(to) - from);
    std::array<std::span<const uint32_t>, kPacketSize> ways;
    ways[5] = way;
    const uint32_t arrived = mirrors.connected(run.tracer, rays, 1u << 5, ways);
    EXPECT_EQ(arrived & ~(1u << 5), 0u);
    return arrived != 0;
  };
  EXPECT_TRUE(connects({3, 2, 2}, {}));
  EXPECT_FALSE(connects({-1, 2, 2}, {}));  // behind the wall
  EXPECT_TRUE(connects({-1, 2, 2}, {x}));  // an image in it
  EXPECT_FALSE(connects({-1, 2, 2}, {y}));
  EXPECT_FALSE(connects({1, 1, 1.5}, {x}));    // before the mirror: nothing that it shows
  EXPECT_FALSE(connects({-1, 2, 3}, {x}));     // the image of something above the ceiling
  EXPECT_TRUE(connects({-3, -1, 2}, {x, y}));  // meets x0 at y = 0.2 first
  EXPECT_FALSE(connects({-3, -1, 2}, {y, x}));
  EXPECT_TRUE(connects({-1, -2, 2}, {y, x}));  // meets y0 at x = 1 first
  EXPECT_FALSE(connects({-1, -2, 2}, {y}));
}

// Means over patches of different sizes differ in rounding and are one mirror all the same; parts that reflect differently are one
// each, with an outline wherever they are on the facet.
TEST(PlanarMirrors, AreOnePerPlaneAndReflectance) {
  std::vector<TestSurface> surfaces = closedBox({4, 3, 2.7}, Rgb(0.05));
  surfaces[0].mirror = Rgb(0.9);
  RayRun run(loadSurfaces(surfaces), {200, 0}, {});
  const std::vector<uint32_t> parts = run.patchesOf("x0");
  for (const double factor : {1 - 1e-15, 0.5}) {
    for (size_t k = parts.size() / 2; k < parts.size(); ++k) run.patches.patches[parts[k]].mirror = factor * Rgb(0.9);
    const PlanarMirrors mirrors(run.facets, run.patches);
    ASSERT_EQ(mirrors.all().size(), factor < 0.9 ? 2u : 1u);
    for (const PlanarMirror& mirror : mirrors.all()) EXPECT_EQ(mirror.outlines.size(), 1u);
    EXPECT_EQ(mirrors.ofPatch()[parts.front()], 0u);
    EXPECT_EQ(mirrors.ofPatch()[parts.back()], factor < 0.9 ? 1u : 0u);
  }
}

TEST(LampImages, NeedALampBeforeTheMirrorAndAMirrorBeforeTheLamp) {
  std::vector<TestSurface> surfaces = room();
  surfaces.push_back(
      {"mirror", {{{0.5, 0.5, 0.4}, {0.5, 0.5, 2.2}, {0.5, 2.5, 2.2}, {0.5, 2.5, 0.4}}}, Rgb(0)});  // faces x0: away from the lamp
  surfaces.back().mirror = Rgb(1);
  EXPECT_EQ(Lit(surfaces, 200, 16).images->size(), 0u);
  surfaces = room();
  surfaces.push_back(
      {"mirror", {{{1, 1, 2.65}, {1, 1.5, 2.65}, {2, 1.5, 2.65}, {2, 1, 2.65}}}, Rgb(0)});  // behind the lamp, facing its back
  surfaces.back().mirror = Rgb(1);
  EXPECT_EQ(Lit(surfaces, 200, 16).images->size(), 0u);
}

// What a patch of the floor gets by a light and its image.
struct LitByPoints {
  explicit LitByPoints(const std::vector<PunctualLight>& lights, const std::vector<TestSurface>& surfaces = floorBeforeAMirror())
      : run(loadSurfaces(surfaces), {400, 0}, {}), mirrors(run.facets, run.patches) {
    const auto found = lightImages(lights, run.facets.frame, mirrors, {});
    EXPECT_TRUE(found);
    if (found) images = *found;
    std::vector<PunctualLight> all = lights;
    all.insert(all.end(), images.begin(), images.end());
    direct = DirectIrradiance(run.tracer, run.facets, run.patches, {}, all, {256, 1, &mirrors})
                 .compute(std::vector<double>(run.patches.size(), 1.0));
  }
  Rgb mean(uint32_t patch, const PunctualLight& light) const {
    Rgb sum(0);
    for (const Position& p : positionsOn(run.facets, run.patches, patch, 64, 1))
      sum += p.weight * unoccludedIrradiance(light, run.facets.frame.toScene(p.point), p.normal);
    return sum;
  }
  RayRun run;
  PlanarMirrors mirrors;
  std::vector<PunctualLight> images;
  DirectLight direct;
};

TEST(LightImages, OfPointsAndSpotsShineOverAMirror) {
  const PunctualLight point{.name = "point", .position = {1.5, 1.2, 1.4}, .intensity = Rgb(10, 20, 30), .range = 9};
  const PunctualLight spot = spotAtTheMirror(-1.8);
  for (const PunctualLight& light : {point, spot}) {
    const LitByPoints lit({light});
    ASSERT_EQ(lit.images.size(), 1u);
    PunctualLight image = light;  // by hand
    image.position.x *= -1;
    image.direction.x *= -1;
    Rgb sum(0), exact(0);
    for (const uint32_t i : lit.run.patchesOf("floor")) {
      const double area = lit.run.patches.patches[i].area;
      const Rgb expected = lit.mean(i, light) + kMirrorWall * lit.mean(i, image);
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(lit.direct.irradiance[i][c], expected[c], 0.02 * expected[c] + 0.02) << light.name;
      sum += area * lit.direct.irradiance[i];
      exact += area * expected;
    }
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(sum[c], exact[c], 0.002 * exact[c]) << light.name;
  }
}

// The strip of the floor that the wall throws light on is three quarters of its height wide.
TEST(LightImages, OfTheSunLightAStripBeforeAMirror) {
  const PunctualLight sun = sunAtTheMirror();
  const LitByPoints lit({sun});
  ASSERT_EQ(lit.images.size(), 1u);
  Rgb flux(0);
  for (const uint32_t i : lit.run.patchesOf("floor")) flux += lit.run.patches.patches[i].area * lit.direct.irradiance[i];
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(flux[c], 5 * 0.8 * (12 + kMirrorWall[c] * 1.5 * 3), 0.01 * flux[c]);
  // From the other side it meets the back of the wall, which is black.
  PunctualLight behind = sun;
  behind.direction.x *= -1;
  EXPECT_TRUE(LitByPoints({behind}).images.empty());
  EXPECT_TRUE(LitByPoints({{.name = "point behind", .position = {-1, 1, 1}, .intensity = Rgb(1)}}).images.empty());
}

// Two mirrors at right angles: each shows what the other does, and together they show it once.
TEST(LightImages, ShineFromACorner) {
  std::vector<TestSurface> corner = floorBeforeAMirror();
  corner.push_back({"other", {{{0, 0, 0}, {0, 0, 2}, {4, 0, 2}, {4, 0, 0}}}, Rgb(0), Rgb(0), false, Rgb(0.5)});
  const PunctualLight light{.name = "point", .position = {1, 1, 1}, .intensity = Rgb(10)};
  const LitByPoints lit({light}, corner);
  EXPECT_EQ(lit.images.size(), 4u);
  double sum = 0, exact = 0;
  for (const uint32_t i : lit.run.patchesOf("floor")) {
    const double area = lit.run.patches.patches[i].area;
    sum += area * lit.direct.irradiance[i].r;
    for (const double x : {1.0, -1.0}) {
      for (const double y : {1.0, -1.0}) {
        PunctualLight image = light;
        image.position = {x, y, 1};
        exact += area * (x < 0 ? kMirrorWall.r : 1) * (y < 0 ? 0.5 : 1) * lit.mean(i, image).r;
      }
    }
  }
  EXPECT_NEAR(sum, exact, 0.005 * exact);
}

}  // namespace
}  // namespace farol::test
