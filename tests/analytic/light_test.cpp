// Direct light, sensors and rows by rays in scenes whose answer is on paper.
#include "factor_run.h"
#include "formfactor/analytic.h"
#include "light/direct.h"
#include "solve/sensors.h"
#include "solve/solver.h"

#include <cstring>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

namespace farol::test {
namespace {

std::vector<TestSurface> lampRoom(bool blocked) {
  auto surfaces = closedBox({4, 4, 2.7}, Rgb(0.5));
  const auto square = [](double half, double z, bool down) {
    std::vector<Vec3> p = {{2 - half, 2 - half, z}, {2 + half, 2 - half, z}, {2 + half, 2 + half, z}, {2 - half, 2 + half, z}};
    if (down) std::reverse(p.begin(), p.end());
    return p;
  };
  surfaces.push_back({"lamp", {square(0.2, 2.6, true)}, Rgb(0), Rgb(100)});
  if (blocked) surfaces.push_back({"table", {square(0.5, 0.75, false)}, Rgb(0.5), Rgb(0), true});
  return surfaces;
}

DirectLight directLight(RayRun& run, const std::vector<PunctualLight>& lights, const DirectOptions& options = {}) {
  const LampPlan plan = chooseLamps(run.facets, run.patches, {});
  const DirectIrradiance light(run.tracer, run.facets, run.patches, plan.lamps, lights, options);
  return light.compute(std::vector<double>(run.patches.size(), 1.0));
}

// Patches are looked at some thousands at a time: none is left out, and their flux is that of fewer.
TEST(DirectLight, ReachesTensOfThousandsOfPatches) {
  std::array<double, 2> flux{};
  for (const size_t k : {size_t{0}, size_t{1}}) {
    RayRun run(loadSurfaces(lampRoom(true)), {k == 0 ? size_t{2000} : size_t{40000}, 0}, {});
    size_t last = 0;
    const LampPlan plan = chooseLamps(run.facets, run.patches, {});
    const DirectIrradiance light(run.tracer, run.facets, run.patches, plan.lamps, {}, {});
    const DirectLight d = light.compute(std::vector<double>(run.patches.size(), 1.0), [&](size_t done) {
      EXPECT_GT(done, last);
      last = done;
    });
    EXPECT_EQ(last, 2 * run.patches.size());
    for (size_t i = 0; i < run.patches.size(); ++i) flux[k] += run.patches.patches[i].area * d.irradiance[i].r;
  }
  EXPECT_NEAR(flux[1], flux[0], 0.002 * flux[0]);
}

TEST(DirectLight, OfALampIsTheClosedFormWhereNothingBlocks) {
  RayRun run(loadSurfaces(lampRoom(false)), {600, 0}, {});
  const DirectLight d = directLight(run, {});
  const UnoccludedFactor exact(run.facets, run.patches);
  const std::vector<uint32_t> lamp = run.patchesOf("lamp");
  for (uint32_t i = 0; i < run.patches.size(); ++i) {
    const std::string surface = surfaceNameOf(run.scene, run.patches.patches[i]);
    if (surface == "z1" || surface == "lamp") continue;  // beside the lamp's edge, or behind it
    double h = 0;
    for (const uint32_t j : lamp) h += 100 * exact(i, j);
    // 2 x 2 Gauss points; 6 x 6 where the lamp's plane cuts the patch, which leave 0.2 % of the mean (about 1).
    EXPECT_NEAR(d.irradiance[i].r, h, 1e-3 * h + 2e-3) << i << " on " << surface;
  }
}

// A plate just above the floor: patches as large as the plate are in the light or under it, and none is in both. A grid that
// knows nothing of the plate would leave three quarters of the light in every patch.
TEST(DirectLight, EndsBetweenPatchesWhereAPlateNearlyTouches) {
  const std::vector<TestSurface> surfaces{
      {"floor", {rectangle(0, 0, 4, 4, 0)}},
      {"plate", {rectangle(1, 1, 3, 3, 0.002)}, Rgb(0), Rgb(0), true},
      {"lamp", {{{1.5, 1.5, 4}, {1.5, 2.5, 4}, {2.5, 2.5, 4}, {2.5, 1.5, 4}}}, Rgb(0), Rgb(100)}};
  RayRun run(loadSurfaces(surfaces), {0, 2}, {});
  const DirectLight d = directLight(run, {}, {.shadowRays = 1024});
  const UnoccludedFactor exact(run.facets, run.patches);
  const uint32_t lamp = run.patchesOf("lamp")[0];
  ASSERT_EQ(run.patchesOf("floor").size(), 9u);
  for (const uint32_t i : run.patchesOf("floor")) {
    const bool under = glm::distance(run.patches.patches[i].centre, Vec3(2, 2, 0)) < 0.1;
    const double h = 100 * exact(i, lamp, 16);
    EXPECT_NEAR(d.irradiance[i].r, under ? 0 : h, 0.003 * h) << i;
  }
}

// Two slopes of 20 degrees, the left one of twice the area, as one patch: the mean over both of what each gets by its own
// normal, from the sun, from a lamp, and along rays.
TEST(DirectLight, OfABentPatchIsTheMeanOverItsPieces) {
  const double fall = std::tan(20 * kPi / 180);
  const std::vector<TestSurface> surfaces{
      {"roof",
       {{{-2, 0, -2 * fall}, {0, 0, 0}, {0, 1, 0}, {-2, 1, -2 * fall}}, {{0, 0, 0}, {1, 0, -fall}, {1, 1, -fall}, {0, 1, 0}}}},
      {"lamp", {{{2, 0.4, 1}, {2, 0.7, 1}, {2.3, 0.7, 1}, {2.3, 0.4, 1}}}, Rgb(0), Rgb(100)}};
  PatchOptions one{0, 10};
  one.cluster = 45;
  RayRun bent(loadSurfaces(surfaces), one, {.rays = 1u << 18}), apart(loadSurfaces(surfaces), {0, 10}, {.rays = 1u << 18});
  ASSERT_EQ(bent.patchesOf("roof").size(), 1u);
  ASSERT_EQ(apart.patchesOf("roof").size(), 2u);
  const UnoccludedFactor exact(apart.facets, apart.patches);
  const Vec3 sun = glm::normalize(Vec3(-0.5, 0, -1));
  PunctualLight light;
  light.kind = PunctualLight::Kind::directional;
  light.direction = sun;
  light.intensity = Rgb(2);
  double fromSun = 0, factor = 0;
  for (const uint32_t i : apart.patchesOf("roof")) {
    const Patch& p = apart.patches.patches[i];
    const double share = p.area / bent.patches.patches[bent.patchesOf("roof")[0]].area;
    fromSun += share * 2 * -glm::dot(p.normal, sun);
    for (const uint32_t j : apart.patchesOf("lamp")) factor += share * exact(i, j, 16);
  }
  const uint32_t roof = bent.patchesOf("roof")[0];
  const LampPlan noLamps;
  const DirectIrradiance onlySun(bent.tracer, bent.facets, bent.patches, noLamps.lamps, {&light, 1}, {});
  EXPECT_NEAR(onlySun.compute(std::vector<double>(bent.patches.size(), 1.0)).irradiance[roof].r, fromSun, 1e-6 * fromSun);
  const DirectLight fromLamp = directLight(bent, {}, {.shadowRays = 4096});
  EXPECT_NEAR(fromLamp.irradiance[roof].r, 100 * factor, 0.005 * 100 * factor);
  EXPECT_NEAR(bent.factor("roof", "lamp"), factor, 4 * std::sqrt(factor / (1u << 18)));
}

// What rounds of shadow rays tell is the error: at most three times too large, and hardly too small.
TEST(DirectLight, ErrorIsToldByRoundsOfRays) {
  RayRun run(loadSurfaces(lampRoom(true)), {2400, 0}, {});
  const DirectLight fine = directLight(run, {}, {.shadowRays = 16384});
  for (const uint32_t rays : {16u, 64u, 256u}) {
    double told = 0, truth = 0;
    for (const uint64_t seed : {1, 2, 3, 4}) {
      const DirectLight d = directLight(run, {}, {.shadowRays = rays, .seed = seed});
      for (size_t i = 0; i < run.patches.size(); ++i) {
        told += d.deviation[i].r * d.deviation[i].r;
        truth += std::pow(d.irradiance[i].r - fine.irradiance[i].r, 2);
      }
    }
    EXPECT_GT(std::sqrt(told), 0.7 * std::sqrt(truth)) << rays;
    EXPECT_LT(std::sqrt(told), 3 * std::sqrt(truth)) << rays;
  }
}

// A fourth of the rays asked for where nothing is in the way, four times as many where neighbours see a lamp partly.
TEST(DirectLight, RaysGoWhereShadowsEnd) {
  RayRun open(loadSurfaces(lampRoom(false)), {2400, 0}, {}), blocked(loadSurfaces(lampRoom(true)), {2400, 0}, {});
  constexpr uint32_t kRays = 256;
  const auto perPatch = [&](RayRun& run) {
    return static_cast<double>(directLight(run, {}, {.shadowRays = kRays}).rays) / static_cast<double>(run.patches.size());
  };
  EXPECT_LE(perPatch(open), kRays / 4.0 + 1);
  EXPECT_GT(perPatch(open), kRays / 8.0);
  EXPECT_GT(perPatch(blocked), 1.5 * perPatch(open));
  EXPECT_LT(perPatch(blocked), kRays);
}

// Two slopes as one patch, a lamp that a screen hides from part of the larger one: origins are spread over both by area.
TEST(DirectLight, OfABentPatchKnowsWhichPieceIsInShadow) {
  const double fall = std::tan(20 * kPi / 180);
  const std::vector<TestSurface> surfaces{
      {"roof",
       {{{-2, 0, -2 * fall}, {0, 0, 0}, {0, 1, 0}, {-2, 1, -2 * fall}}, {{0, 0, 0}, {1, 0, -fall}, {1, 1, -fall}, {0, 1, 0}}}},
      {"lamp", {{{-0.15, 0.35, 2}, {-0.15, 0.65, 2}, {0.15, 0.65, 2}, {0.15, 0.35, 2}}}, Rgb(0), Rgb(100)},
      {"screen", {{{-3, -1, 0.5}, {-0.6, -1, 0.5}, {-0.6, 2, 0.5}, {-3, 2, 0.5}}}, Rgb(0.5), Rgb(0), true}};
  constexpr uint32_t kRays = 16384;
  PatchOptions one{0, 10};
  one.cluster = 45;
  RayRun bent(loadSurfaces(surfaces), one, {}), apart(loadSurfaces(surfaces), {0, 10}, {});
  ASSERT_EQ(bent.patchesOf("roof").size(), 1u);
  const DirectLight together = directLight(bent, {}, {.shadowRays = kRays}), each = directLight(apart, {}, {.shadowRays = kRays});
  double mean = 0, area = 0;
  for (const uint32_t i : apart.patchesOf("roof")) {
    mean += apart.patches.patches[i].area * each.irradiance[i].r;
    area += apart.patches.patches[i].area;
  }
  EXPECT_NEAR(together.irradiance[bent.patchesOf("roof")[0]].r, mean / area, 0.005 * mean / area);
}

// A block without a bottom face stands on the floor: of a patch that it covers in part, of some less than a hundredth is left, only
// the exposed part is lit, as rays see it, and what lies under the block is not taken for shadow.
TEST(DirectLight, OfAPartlyCoveredPatchIsThatOfItsExposedPart) {
  struct Case {
    Vec3 low, high;
    uint32_t shadowRays;
    double exposedAtMost;
  };
  constexpr double kCell = 4.0 / 11, kSliver = 0.008 * kCell;
  const Vec3 low(4 * kCell + kSliver, 4 * kCell + kSliver, 0), high(7 * kCell - kSliver, 7 * kCell - kSliver, 0.003);
  for (const Case& c : {Case{{1.53, 1.53, 0}, {2.47, 2.47, 0.3}, 4096, 0.9}, Case{low, high, 16, 0.03}}) {
    auto surfaces = lampRoom(false);
    const auto wall = [&](const Vec3& a, const Vec3& b) {
      return std::vector<Vec3>{{a.x, a.y, 0}, {b.x, b.y, 0}, {b.x, b.y, c.high.z}, {a.x, a.y, c.high.z}};
    };
    // Turned a hair, or the floor would be divided along it.
    constexpr double kTurn = 0.002;
    const Vec3 p = c.low + Vec3(kTurn, 0, 0), q(c.high.x, c.low.y + kTurn, 0), r = c.high - Vec3(kTurn, 0, 0),
               s(c.low.x, c.high.y - kTurn, 0);
    surfaces.push_back(
        {"block",
         {wall(p, q), wall(q, r), wall(r, s), wall(s, p), {{p.x, p.y, r.z}, {q.x, q.y, r.z}, {r.x, r.y, r.z}, {s.x, s.y, r.z}}}});
    RayRun run(loadSurfaces(surfaces), {600, 0}, {.rays = 1u << 17});
    run.makeRowsOf("z0");
    std::vector<double> exposed(run.patches.size(), 1.0);
    for (const uint32_t i : run.patchesOf("z0")) exposed[i] = run.f.shares(i).exposed;
    const LampPlan plan = chooseLamps(run.facets, run.patches, {});
    const DirectLight d =
        DirectIrradiance(run.tracer, run.facets, run.patches, plan.lamps, {}, {.shadowRays = c.shadowRays}).compute(exposed);
    const std::vector<uint32_t> lamp = run.patchesOf("lamp");
    size_t partly = 0;
    double found = 0, expected = 0, variance = 0;
    for (const uint32_t i : run.patchesOf("z0")) {
      if (exposed[i] < 0.005 || exposed[i] > c.exposedAtMost) continue;
      double h = 0;
      run.f[i].forEach([&](size_t j, double f) { h += std::find(lamp.begin(), lamp.end(), j) != lamp.end() ? 100 * f : 0; });
      const double noise = 100 * std::sqrt(std::max(h / 100, 1e-5) / (exposed[i] * (1 << 17)));
      EXPECT_NEAR(d.irradiance[i].r, h, 0.02 * h + 4 * noise) << i << " exposed " << exposed[i];
      ++partly;
      found += d.irradiance[i].r;
      expected += h;
      variance += noise * noise;
    }
    EXPECT_NEAR(found, expected, 0.02 * expected + 4 * std::sqrt(variance)) << "exposed by " << c.exposedAtMost << " at most";
    EXPECT_GE(partly, 4u) << "exposed by " << c.exposedAtMost << " at most";
  }
}

// Behind a table: against rays by the hundred thousand.
TEST(DirectLight, OfALampIsWithinItsErrorWhereATableBlocks) {
  RayRun run(loadSurfaces(lampRoom(true)), {600, 0}, {.rays = 1u << 18});
  run.makeRowsOf("z0");
  const DirectLight d = directLight(run, {}), fine = directLight(run, {}, {.shadowRays = 16384});
  std::vector<bool> lamp(run.patches.size(), false);
  for (const uint32_t j : run.patchesOf("lamp")) lamp[j] = true;
  size_t within = 0, all = 0, shaded = 0;
  double meanOf = 0, meanFound = 0;
  for (const uint32_t i : run.patchesOf("z0")) {
    double h = 0;
    run.f[i].forEach([&](size_t j, double f) { h += lamp[j] ? 100 * f : 0; });
    const double noise = 100 * std::sqrt(std::max(h / 100, 1e-5) / (1 << 18));
    if (std::abs(d.irradiance[i].r - h) <= 3 * (d.deviation[i].r + noise)) ++within;
    EXPECT_NEAR(fine.irradiance[i].r, h, 4 * noise + 0.01 * h) << i;
    if (d.irradiance[i].r < 1e-9) ++shaded;
    ++all;
    meanOf += h;
    meanFound += d.irradiance[i].r;
  }
  EXPECT_GE(within, 0.98 * static_cast<double>(all));
  EXPECT_GT(shaded, 0u);
  EXPECT_NEAR(meanFound, meanOf, 0.003 * meanOf);
}

TEST(DirectLight, OfPunctualLightsFollowsTheInverseSquareAndCastsShadows) {
  RayRun run(loadSurfaces(lampRoom(true)), {2000, 0}, {});
  for (const double height : {2.2, 1.2}) {  // the table is nearer to the floor, or nearer to the light
    PunctualLight point;
    point.kind = PunctualLight::Kind::point;
    point.position = {2, 2, height};
    point.intensity = Rgb(1000, 500, 250);
    const DirectLight d = DirectIrradiance(run.tracer, run.facets, run.patches, {}, {&point, 1}, {})
                              .compute(std::vector<double>(run.patches.size(), 1.0));
    for (const uint32_t i : run.patchesOf("z0")) {
      const Vec3 c = run.patches.patches[i].centre, to = point.position - c;
      const double r2 = glm::dot(to, to), h = 1000 * height / (r2 * std::sqrt(r2));
      const Rgb found = d.irradiance[i];
      // The table at 0.75 m of half width 0.5 throws a shadow of half width 0.5 * height / (height - 0.75).
      const double edge = 0.5 * height / (height - 0.75), away = std::max(std::abs(c.x - 2), std::abs(c.y - 2));
      if (away < edge - 0.1) {
        EXPECT_NEAR(found.r, 0, 1e-9);
      } else if (away > edge + 0.1) {
        EXPECT_NEAR(found.r, h, 0.003 * h);
        EXPECT_NEAR(found.b, 0.25 * found.r, 1e-9 * h);
      }
    }
  }
}

// The choice of lamps: small bright ones apart, light from all around in F.
TEST(LampChoice, LeavesFurnacesAndGlowingCeilingsInF) {
  const auto apart = [](const std::vector<TestSurface>& surfaces) {
    const RayRun run(loadSurfaces(surfaces), {1000, 0}, {});
    return chooseLamps(run.facets, run.patches, {}).lamps.size();
  };
  EXPECT_EQ(apart(lampRoom(false)), 1u);
  EXPECT_EQ(apart(closedBox({1, 1, 1}, Rgb(0.5), Rgb(1))), 0u);
  auto ceiling = closedBox({4, 4, 2.7}, Rgb(0.5));
  ceiling[5].emission = Rgb(10);
  EXPECT_EQ(apart(ceiling), 0u);
}

// The answer does not depend on the split: with lamps apart and with all in F.
TEST(EmittersApart, GiveTheAnswerOfTheMatrix) {
  RayRun run(loadSurfaces(lampRoom(true)), {400, 0}, {.rays = 65536});
  run.makeAll();
  DirectLight direct = directLight(run, {}, {.shadowRays = 4096});
  direct.apart = chooseLamps(run.facets, run.patches, {}).apart;
  const Solution matrix = solveRadiosity(run.f, run.patches, {}, run.scene, {}, Log(true));
  const Solution apart = solveRadiosity(run.f, run.patches, direct, run.scene, {}, Log(true));
  // A wall's patch has some 200 of its 65,536 rays on the lamp: 1 to 2 % per patch, much less for the mean.
  double difference = 0, mean = 0, total = 0;
  for (uint32_t i = 0; i < run.patches.size(); ++i) {
    const double by = run.patches.patches[i].area * (matrix.irradiance[i].r - apart.irradiance[i].r);
    difference += std::abs(by);
    mean += by;
    total += run.patches.patches[i].area * matrix.irradiance[i].r;
  }
  EXPECT_LT(difference / total, 0.02);
  EXPECT_LT(std::abs(mean) / total, 0.003);
}

TEST(RayRows, AreTheSameOnOneThreadAndOnTwo) {
  const Scene scene = loadSurfaces(lampRoom(true));
  const auto made = [&](int threads, uint64_t seed, uint32_t rays) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<size_t>(threads));
    auto run = std::make_unique<RayRun>(scene, PatchOptions{700, 0}, RayOptions{.rays = rays, .seed = seed});
    run->makeAll();
    return run;
  };
  for (const uint32_t rays : {100u, 2048u}) {
    const auto one = made(1, 1, rays), two = made(2, 1, rays), other = made(2, 2, rays);
    size_t different = 0;
    for (uint32_t i = 0; i < one->patches.size(); ++i) {
      const auto a = one->f[i].expanded(), b = two->f[i].expanded(), c = other->f[i].expanded();
      ASSERT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0) << "row " << i;
      different += a != c ? 1 : 0;
    }
    EXPECT_GT(different, one->patches.size() / 2) << "the seed changes rows";
  }
}

// What cannot be: more through a blocker than without it, factors beyond their bounds.
TEST(RayRows, KeepTheirInvariants) {
  RayRun free(loadSurfaces(lampRoom(false)), {300, 0}, {.rays = 4096}),
      blocked(loadSurfaces(lampRoom(true)), {300, 0}, {.rays = 4096});
  EXPECT_LT(blocked.factor("z0", "lamp"), 0.9 * free.factor("z0", "lamp"));
  EXPECT_LE(blocked.factor("x0", "x1"), 1.001 * free.factor("x0", "x1"));
  free.makeAll();
  const FormFactorChecks checks = checkFormFactors(free.f, free.patches);
  EXPECT_GE(checks.smallest, 0);
  EXPECT_LE(checks.largest, 1);
  EXPECT_LT(checks.rowSumMax, 1 + 1e-6);
}

std::vector<SensorReading> read(const std::vector<TestSurface>& surfaces, const std::vector<Sensor>& sensors,
                                size_t patches = 1000) {
  RayRun run(loadSurfaces(surfaces), {patches, 0}, {.rays = 1024});
  run.makeAll();
  const LampPlan plan = chooseLamps(run.facets, run.patches, {});
  const DirectIrradiance light(run.tracer, run.facets, run.patches, plan.lamps, {}, {});
  DirectLight direct;
  if (!plan.lamps.empty()) direct = light.compute(std::vector<double>(run.patches.size(), 1.0));
  direct.apart = plan.apart;
  const Solution s = solveRadiosity(run.f, run.patches, direct, run.scene, {.residual = 1e-8}, Log(true));
  const RayTree tree(run.tracer, run.facets, run.patches, {});
  return readSensors(tree, run.tracer, run.facets, run.patches, light, direct, s, sensors, {});
}

std::vector<Sensor> someSensors() {
  std::vector<Sensor> sensors;
  for (const Vec3& n : {Vec3(0, 0, 1), Vec3(1, 0, 0), Vec3(-0.6, 0, 0.8), Vec3(0, -1, 0)})
    for (const Vec3& p : {Vec3(0.5, 0.5, 0.5), Vec3(0.3, 0.6, 0.2), Vec3(0.8, 0.25, 0.7)}) sensors.push_back({p, n});
  return sensors;
}

// Anywhere in a furnace: H = E / (1 - rho).
TEST(Sensors, ReadTheFurnace) {
  for (const SensorReading& r : read(closedBox({1, 1, 1}, Rgb(0.2, 0.5, 0.9), Rgb(1)), someSensors())) {
    EXPECT_NEAR(r.irradiance.r, 1.25, 1e-5 * 1.25);
    EXPECT_NEAR(r.irradiance.g, 2.0, 1e-5 * 2);
    EXPECT_NEAR(r.irradiance.b, 10.0, 1e-4 * 10);
    EXPECT_LT(r.error, 1e-3);
  }
}

// A black box under a glowing ceiling: the point-to-rectangle factor, by its closed form.
TEST(Sensors, ReadAGlowingCeilingWithinTheirError) {
  auto box = closedBox({1, 1, 1}, Rgb(0));
  box[5].emission = Rgb(3, 2, 1);
  size_t within = 0, all = 0;
  const std::vector<Sensor> sensors = someSensors();
  const auto readings = read(box, sensors);
  for (size_t k = 0; k < sensors.size(); ++k) {
    const Vec3 p = sensors[k].position;
    const std::vector<Vec3> ceiling = {{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}};
    const double h = 3 * pointToPolygon(p, sensors[k].normal, ceiling);
    if (std::abs(readings[k].irradiance.r - h) <= 2 * readings[k].error) ++within;
    EXPECT_NEAR(readings[k].irradiance.r, h, 0.01 * 3);
    EXPECT_LT(readings[k].error, 0.02 * 3);
    ++all;
  }
  EXPECT_GE(within, all - 1);
}

// Half of a lamp hidden by a screen close below it, in a black room: Lambert's sum over the part that a sensor sees,
// which the screen's edge cuts at x = 2 seen from the sensor.
TEST(Sensors, ReadAHalfHiddenLampWithinTheirError) {
  auto scene = lampRoom(false);
  for (TestSurface& s : scene) s.reflectance = Rgb(0);
  constexpr double kLamp = 2.6, kScreen = 2.55;
  scene.push_back({"screen", {{{1, 1, kScreen}, {2, 1, kScreen}, {2, 3, kScreen}, {1, 3, kScreen}}}, Rgb(0), Rgb(0), true});
  std::vector<Sensor> sensors;
  for (int k = 0; k < 64; ++k) sensors.push_back({{1.2 + 0.2 * (k % 8), 1.2 + 0.2 * (k / 8), 0.8}, {0, 0, 1}});
  const auto readings = read(scene, sensors, 400);
  size_t within = 0;
  for (size_t k = 0; k < sensors.size(); ++k) {
    const Vec3 p = sensors[k].position;
    const double cut = std::clamp(p.x + (2 - p.x) * (kLamp - p.z) / (kScreen - p.z), 1.8, 2.2);
    const double h =
        100 * pointToPolygon(p, sensors[k].normal,
                             std::vector<Vec3>{{2.2, 1.8, kLamp}, {cut, 1.8, kLamp}, {cut, 2.2, kLamp}, {2.2, 2.2, kLamp}});
    EXPECT_NEAR(readings[k].irradiance.r, h, 0.01 * h) << k;  // 1,024 rays: 0.1 % on average
    if (std::abs(readings[k].irradiance.r - h) <= 2 * readings[k].error) ++within;
  }
  EXPECT_GE(within, 61u);  // 95 of 100
}

// Inside a sphere: the irradiance at its wall, on a facet's plane (integrating sphere, truth B2a).
TEST(Sensors, ReadTheIntegratingSphere) {
  auto zones = sphereZones("zone", 1, true, {-1, -0.96, 1}, 40);
  zones[0].reflectance = Rgb(0);
  zones[0].emission = Rgb(10);
  zones[1].reflectance = Rgb(0.9);
  std::vector<Sensor> sensors;
  for (const Vec3& d : {glm::normalize(Vec3(1, 0.3, 0.1)), glm::normalize(Vec3(-0.2, 1, 0.5))}) sensors.push_back({0.98 * d, -d});
  for (const SensorReading& r : read(zones, sensors))
    EXPECT_NEAR(r.irradiance.r, 1.694915254237288, 0.02 * 1.695 + 2 * r.error);  // 40 segments: 1 % less cap
}

}  // namespace
}  // namespace farol::test
