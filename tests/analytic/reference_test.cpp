// The gathering reference against closed forms, and what it says of the error of a solution.
#include "formfactor/analytic.h"
#include "formfactor/near_field.h"
#include "formfactor/rays.h"
#include "light/direct.h"
#include "reference/gathering.h"
#include "solve/patch_error.h"
#include "specular_cases.h"

#include <numeric>

namespace farol::test {
namespace {

Scene withLights(Scene scene, const std::vector<PunctualLight>& lights) {
  scene.lights = lights;
  return scene;
}

struct Gathered {
  explicit Gathered(const std::vector<TestSurface>& surfaces, const Rgb& sky = Rgb(0), size_t count = 60, double seconds = 0.5,
                    const std::vector<PunctualLight>& lights = {})
      : scene(withLights(loadSurfaces(surfaces), lights)),
        facets(buildFacets(scene, log)),
        patches(buildPatches(scene, facets, {count, 0})),
        tracer(facets),
        lamps(chooseLamps(facets, patches, {})) {
    gather(PathGatherer(tracer, facets, patches, scene, lamps, sky, {}), seconds);
  }
  void gather(const PathGatherer& gatherer, double seconds) {
    const PatchSet* set = &patches;
    truth = gatherIrradiance(gatherer, tracer, facets, std::span(&set, 1), seconds, 5, [](double) {})[0];
  }
  // Mean over a surface, and its standard error: from the halves' difference in each of its patches, so that it wants many.
  std::pair<double, double> of(const std::string& surface) const {
    double sum = 0, variance = 0, area = 0;
    for (size_t i = 0; i < patches.size(); ++i) {
      const Patch& p = patches.patches[i];
      if (surfaceNameOf(scene, p) != surface) continue;
      const double a = p.area * truth.exposed[i], d = truth.half[0][i].r - truth.half[1][i].r;
      sum += 0.5 * a * (truth.half[0][i].r + truth.half[1][i].r);
      variance += 0.25 * a * a * d * d;
      area += a;
    }
    return {sum / area, std::sqrt(variance) / area};
  }
  void expect(const std::string& surface, double exact) const {
    const auto [mean, error] = of(surface);
    EXPECT_LT(error, 0.02 * exact) << surface << ": the test would see nothing";
    EXPECT_NEAR(mean, exact, 4 * error + 1e-9) << surface;
  }
  Log log{true};
  Scene scene;
  FacetSet facets;
  PatchSet patches;
  Tracer tracer;
  LampPlan lamps;
  GatheredIrradiance truth;
};

TEST(GatheringReference, FurnaceIsEmissionOverAbsorption) {
  const Gathered furnace(closedBox({1, 2, 3}, Rgb(0.8), Rgb(1)));
  for (const char* face : {"x0", "y1", "z1"}) furnace.expect(face, 1 / (1 - 0.8));
}

TEST(GatheringReference, SkyIsWhatIsMissed) {
  const Gathered plate({{"plate", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}}, Rgb(3));
  plate.expect("plate", 3);
}

// Two plates, one reflection each way and so on: B1 = E / (1 - rho1 rho2 F^2) between uniform plates; here rho1 = 0, so that
// nothing but F E arrives.
TEST(GatheringReference, DirectLightIsTheFormFactor) {
  constexpr double kF = 0.19982489569838738;  // facing unit squares at distance 1
  const std::vector<TestSurface> plates = {{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0)},
                                           {"2", {{{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}}}, Rgb(0), Rgb(5)}};
  Gathered(plates).expect("1", 5 * kF);
  // The same as a lamp apart: a small part of a larger scene.
  std::vector<TestSurface> apart = plates;
  apart.push_back({"ground", {{{20, 20, 0}, {40, 20, 0}, {40, 40, 0}, {20, 40, 0}}}, Rgb(0)});
  const Gathered withLamp(apart, Rgb(0), 6000);
  EXPECT_EQ(withLamp.lamps.lamps.size(), 1u);
  withLamp.expect("1", 5 * kF);
}

// A lamp that touches the plate: shadow rays alone would have no finite variance.
TEST(GatheringReference, LampsMayTouchWhatTheyLight) {
  constexpr double kF = 0.2000437760754032;  // unit squares with a common edge (form_factors.json, A3a)
  const Gathered corner({{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0)},
                         {"2", {{{0, 0, 0}, {0, 1, 0}, {0, 1, 1}, {0, 0, 1}}}, Rgb(0), Rgb(5)},
                         {"ground", {{{20, 20, 0}, {25, 20, 0}, {25, 25, 0}, {20, 25, 0}}}, Rgb(0)}},
                        Rgb(0), 600);
  EXPECT_EQ(corner.lamps.lamps.size(), 1u);
  corner.expect("1", 5 * kF);
  EXPECT_LT(corner.of("1").second, 0.005 * 5 * kF);
}

// The same where a path ends: a ceiling next to a lamp sees the wall that the lamp touches.
TEST(GatheringReference, FinalGatheringSeesLampsThatTouchSurfaces) {
  constexpr double kEnd = 0.25, kEmission = 10, kReflectance = 0.8;
  std::vector<TestSurface> box = closedBox({1, 1, 1}, Rgb(0));
  ASSERT_EQ(box[0].name, "x0");
  ASSERT_EQ(box[5].name, "z1");
  box[0].reflectance = Rgb(kReflectance);
  std::vector<Vec3> ceiling = box[5].polygons[0], lamp = ceiling;
  for (Vec3& v : ceiling) v.x = std::max(v.x, kEnd);
  for (Vec3& v : lamp) v.x = std::min(v.x, kEnd);
  box[5].polygons = {ceiling};
  box.push_back({"lamp", {lamp}, Rgb(0), Rgb(kEmission)});
  double exact = 0;
  constexpr int kPoints = 400;
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      const Vec3 p(0, (i + 0.5) / kPoints, (j + 0.5) / kPoints), normal(1, 0, 0);
      exact += kReflectance * kEmission * pointToPolygon(p, normal, lamp) * pointToPolygon(p, normal, ceiling) /
               (kPoints * kPoints * (1 - kEnd));
    }
  }
  Gathered gathered(box, Rgb(0), 600, 0);
  ASSERT_EQ(gathered.lamps.lamps.size(), 1u);
  const std::vector<double> exposed(gathered.patches.size(), 1.0);
  const std::vector<Rgb> direct =
      DirectIrradiance(gathered.tracer, gathered.facets, gathered.patches, gathered.lamps.lamps, {}, {128, 1})
          .compute(exposed)
          .irradiance;
  PathGatherer finally(gathered.tracer, gathered.facets, gathered.patches, gathered.scene, gathered.lamps, Rgb(0), {});
  finally.endWith(gathered.patches, direct, exposed);
  gathered.gather(finally, 1);
  gathered.expect("z1", exact);
}

// Unequal lamps, near and far, small and large, one turned away: chosen by what they bring about, and what they bring is exact.
TEST(GatheringReference, ChoosesAmongLampsWithoutBias) {
  const auto square = [](double x, double y, double z, double size) {
    return std::vector<std::vector<Vec3>>{{{x, y, z}, {x, y + size, z}, {x + size, y + size, z}, {x + size, y, z}}};
  };
  std::vector<TestSurface> room = {{"floor", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0)},
                                   {"ground", {{{20, 20, 0}, {40, 20, 0}, {40, 40, 0}, {20, 40, 0}}}, Rgb(0)}};
  const std::array<Vec3, 3> at{Vec3(1.1, -0.3, 0.2), Vec3(0.5, 0.6, 1), Vec3(2, 2, 1)};  // none hides another
  const std::array<double, 3> size{0.1, 0.3, 0.5}, emission{2, 5, 40};
  double exact = 0;
  for (size_t l = 0; l < at.size(); ++l) {
    room.push_back({"lamp" + std::to_string(l), square(at[l].x, at[l].y, at[l].z, size[l]), Rgb(0), Rgb(emission[l])});
    const std::vector<Vec3> polygon = square(at[l].x, at[l].y, at[l].z, size[l])[0];
    constexpr int kPoints = 200;
    for (int i = 0; i < kPoints; ++i) {
      for (int j = 0; j < kPoints; ++j)
        exact += emission[l] * pointToPolygon(Vec3((i + 0.5) / kPoints, (j + 0.5) / kPoints, 0), Vec3(0, 0, 1), polygon) /
                 (kPoints * kPoints);
    }
  }
  room.push_back({"away", {{{0.4, 0.4, 3}, {0.6, 0.4, 3}, {0.6, 0.6, 3}, {0.4, 0.6, 3}}}, Rgb(0), Rgb(1000)});
  const Gathered gathered(room, Rgb(0), 12000, 1);
  EXPECT_EQ(gathered.lamps.lamps.size(), 4u);
  gathered.expect("floor", exact);
}

// In a furnace, paths that end with the H of all its surfaces know it at once; with another they show what they were told.
TEST(GatheringReference, FinalGatheringEndsAtTheFirstSurface) {
  Log log(true);
  const Scene scene = loadSurfaces(closedBox({1, 2, 3}, Rgb(0.8), Rgb(1)));
  const FacetSet facets = buildFacets(scene, log);
  const PatchSet patches = buildPatches(scene, facets, {60, 0}), known = buildPatches(scene, facets, {200, 0});
  const Tracer tracer(facets);
  const LampPlan lamps = chooseLamps(facets, patches, {});
  const PatchSet* set = &patches;
  for (const double h : {5.0, 1.0}) {
    const std::vector<Rgb> irradiance(known.size(), Rgb(h));
    PathGatherer gatherer(tracer, facets, patches, scene, lamps, Rgb(0), {});
    gatherer.endWith(known, irradiance, std::vector<double>(known.size(), 1.0));
    const GatheredIrradiance truth = gatherIrradiance(gatherer, tracer, facets, std::span(&set, 1), 0, 5, [](double) {})[0];
    for (const auto& half : truth.half) {
      for (const Rgb& value : half) EXPECT_NEAR(value.r, 1 + 0.8 * h, 1e-9);
    }
  }
}

// A plate under a blocker looks down at a floor half in its shadow. What is known has one patch for all of the floor; where paths
// end direct light is sampled, so that the plate sees the shadow and not the mean.
TEST(GatheringReference, FinalGatheringKeepsShadows) {
  const auto square = [](double x, double y, double z, double side, bool up) {
    std::vector<Vec3> corners = {{x, y, z}, {x + side, y, z}, {x + side, y + side, z}, {x, y + side, z}};
    if (!up) std::reverse(corners.begin(), corners.end());
    return std::vector<std::vector<Vec3>>{corners};
  };
  const std::vector<TestSurface> surfaces = {{"floor", square(-4, -4, 0, 8, true), Rgb(0.8)},
                                             {"blocker", square(-4, -2, 1, 4, true), Rgb(0)},
                                             {"plate", square(-1, -0.2, 0.5, 0.4, false), Rgb(0)},
                                             {"lamp", square(-0.1, -0.1, 4, 0.2, false), Rgb(0), Rgb(1000)}};
  Log log(true);
  const Scene scene = loadSurfaces(surfaces);
  const FacetSet facets = buildFacets(scene, log);
  const PatchSet patches = buildPatches(scene, facets, {2000, 0}), known = buildPatches(scene, facets, {1, 0});
  ASSERT_EQ(known.frontPatchCount, 4u);
  const Tracer tracer(facets);
  const LampPlan lamps = chooseLamps(facets, patches, {});
  ASSERT_EQ(lamps.lamps.size(), 1u);
  const std::vector<double> exposed(known.size(), 1.0);
  const std::vector<Rgb> direct = DirectIrradiance(tracer, facets, known, lamps.lamps, {}, {128, 1}).compute(exposed).irradiance;
  const PatchSet* set = &patches;
  std::array<double, 2> seen{};
  for (const bool finally : {false, true}) {
    PathGatherer gatherer(tracer, facets, patches, scene, lamps, Rgb(0), {});
    if (finally) gatherer.endWith(known, direct, exposed);
    const GatheredIrradiance g = gatherIrradiance(gatherer, tracer, facets, std::span(&set, 1), 1.5, 5, [](double) {})[0];
    double sum = 0, count = 0;
    for (size_t i = 0; i < patches.size(); ++i) {
      if (surfaceNameOf(scene, patches.patches[i]) != "plate") continue;
      sum += 0.5 * (g.half[0][i].r + g.half[1][i].r);
      ++count;
    }
    ASSERT_GT(count, 0);
    seen[finally ? 1 : 0] = sum / count;
  }
  size_t floor = 0;
  while (surfaceNameOf(scene, known.patches[floor]) != "floor") ++floor;
  const double ofMean = 0.8 * direct[floor].r;
  EXPECT_LT(seen[0], 0.6 * ofMean);
  EXPECT_NEAR(seen[1], seen[0], 0.02 * seen[0]) << "a floor of even light would bring up to " << ofMean;
}

// Lux times cosine, and candela over distance squared times cosine; one of the two is behind the plate.
TEST(GatheringReference, PunctualLightsAreAddedUp) {
  PunctualLight sun, lamp, behind;
  sun.kind = PunctualLight::Kind::directional;
  sun.direction = glm::normalize(Vec3(1, 0, -1));
  sun.intensity = Rgb(4);
  lamp.position = Vec3(0.5, 0.5, 100);
  lamp.intensity = Rgb(30000);
  behind.position = Vec3(0.5, 0.5, -100);
  behind.intensity = Rgb(1e9);
  const Gathered plate({{"plate", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}}}, Rgb(0), 60, 0.3, {sun, lamp, behind});
  plate.expect("plate", 4 * std::cos(kPi / 4) + 3);
}

// A small lamp is aimed at, and so is its image in a wall: each of the two counts once, also close to what they light.
TEST(GatheringReference, AimsAtLampsInMirrors) {
  auto room = closedBox({2, 2, 2}, Rgb(0));
  ASSERT_EQ(room[0].name, "x0");
  room[0].mirror = Rgb(0.75);
  room.push_back({"lamp", {}, Rgb(0), Rgb(100)});
  for (const auto& [low, high, z, noise] : {std::tuple(0.4, 0.6, 1.9, 0.001), std::tuple(0.0, 0.5, 0.1, 0.01)}) {
    room.back().polygons = {{{low, 0.9, z}, {low, 1.1, z}, {high, 1.1, z}, {high, 0.9, z}}};
    double exact = 0;
    constexpr int kPoints = 200;
    for (int i = 0; i < kPoints; ++i) {
      for (int j = 0; j < kPoints; ++j) {
        const Vec3 p(2 * (i + 0.5) / kPoints, 2 * (j + 0.5) / kPoints, 0);
        std::vector<Vec3> image = room.back().polygons[0];
        exact += 100 * pointToPolygon(p, Vec3(0, 0, 1), image) / (kPoints * kPoints);
        for (Vec3& v : image) v.x = -v.x;
        std::reverse(image.begin(), image.end());
        exact += 75 * pointToPolygon(p, Vec3(0, 0, 1), image) / (kPoints * kPoints);
      }
    }
    const Gathered gathered(room, Rgb(0), 600, 1);
    EXPECT_EQ(gathered.lamps.lamps.size(), 1u);
    gathered.expect("z0", exact);
    EXPECT_LT(gathered.of("z0").second, noise * exact);
  }
}

// The same of a punctual light; through glass it finds none, and says so.
TEST(GatheringReference, AimsAtPunctualLightsInMirrors) {
  auto room = closedBox({2, 2, 2}, Rgb(0));
  room[0].mirror = Rgb(0.75);
  const PunctualLight light{.name = "light", .position = {0.5, 1, 1.5}, .intensity = Rgb(10)};
  double exact = 0;
  constexpr int kPoints = 200;
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      const Vec3 p(2 * (i + 0.5) / kPoints, 2 * (j + 0.5) / kPoints, 0);
      for (const double side : {1.0, -1.0}) {
        const Vec3 d = Vec3(side * 0.5, 1, 1.5) - p;
        exact += (side > 0 ? 1 : 0.75) * 10 * d.z / std::pow(glm::length(d), 3) / (kPoints * kPoints);
      }
    }
  }
  const Gathered gathered(room, Rgb(0), 600, 0.5, {light});
  gathered.expect("z0", exact);
  const auto misses = [&](const Gathered& g) {
    return PathGatherer(g.tracer, g.facets, g.patches, g.scene, g.lamps, Rgb(0), {}).missesLights();
  };
  EXPECT_FALSE(misses(gathered));
  room[0].mirror = Rgb(0);
  room[0].transmission = Rgb(0.5);
  EXPECT_TRUE(misses(Gathered(room, Rgb(0), 10, 0.01, {light})));
  room.push_back({"lamp", {{{0.4, 0.9, 1.9}, {0.4, 1.1, 1.9}, {0.6, 1.1, 1.9}, {0.6, 0.9, 1.9}}}, Rgb(0), Rgb(100)});
  EXPECT_FALSE(misses(Gathered(room, Rgb(0), 10, 0.01))) << "no light at all";
}

TEST(GatheringReference, ComesThroughMirrorsAndGlass) {
  auto mirror = surfacesOf("C1a");
  for (TestSurface& s : mirror) s.emission = Rgb(s.name == "2" ? 7.0 : 0.0);
  Gathered(mirror).expect("1", 7 * expected("C1a", "F12 extended (through the mirror)"));
  constexpr double h = 1000;
  const double pane = expected("C6a", "slab transmittance if the two polarisations are averaged at every face (usual in graphics)");
  const Gathered glass({{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0)},
                        {"2", {{{-h, -h, 2}, {-h, h, 2}, {h, h, 2}, {h, -h, 2}}}, Rgb(0), Rgb(1)},
                        {"pane", {{{-h, -h, 1}, {h, -h, 1}, {h, h, 1}, {-h, h, 1}}}, Rgb(0), Rgb(0), true, Rgb(0), Rgb(1)}},
                       Rgb(0), 8, 1);
  const auto [mean, error] = glass.of("1");
  EXPECT_NEAR(mean, pane, 4 * error + 0.002);
}

// What glass passes on of a lamp, met by paths that leave the floor, or followed from the lamp: the same, and none of it twice.
TEST(GatheringReference, MayLeaveOutWhatIsFollowedFromLamps) {
  std::vector<TestSurface> room = closedBox({2, 2, 2}, Rgb(0.2));
  room.push_back({"pane", {{{0.3, 0.3, 1}, {1.7, 0.3, 1}, {1.7, 1.7, 1}, {0.3, 1.7, 1}}}, Rgb(0), Rgb(0), true, Rgb(0), Rgb(1)});
  room.push_back({"lamp", {{{0.6, 0.6, 1.9}, {0.6, 1.4, 1.9}, {1.4, 1.4, 1.9}, {1.4, 0.6, 1.9}}}, Rgb(0), Rgb(12)});
  Gathered gathered(room, Rgb(0), 400, 1);
  ASSERT_EQ(gathered.lamps.lamps.size(), 1u);
  const auto met = gathered.of("z0"), metByWall = gathered.of("x0");
  PathGatherer gatherer(gathered.tracer, gathered.facets, gathered.patches, gathered.scene, gathered.lamps, Rgb(0), {});
  EXPECT_FALSE(gatherer.leavesOut());
  gatherer.leaveOutFollowed();
  ASSERT_TRUE(gatherer.leavesOut());
  gathered.gather(gatherer, 1);
  EXPECT_LT(gathered.of("z0").first, 0.6 * met.first) << "most light of the lamp reaches the floor through the pane";
  addFollowed(gatherer, gathered.patches, 1, 3, gathered.truth);  // some rounds
  for (const auto& [surface, before] : {std::pair("z0", met), std::pair("x0", metByWall)}) {
    const auto [mean, error] = gathered.of(surface);
    EXPECT_LT(before.second + error, 0.02 * mean) << surface << ": the test would see nothing";
    EXPECT_NEAR(mean, before.first, 4 * std::hypot(error, before.second)) << surface;
  }
}

// The sun straight down through a pane of glass that covers the scene: no path meets it, followed it is all there.
TEST(GatheringReference, FollowsPunctualLightsThroughGlass) {
  const PunctualLight sun{.name = "sun", .kind = PunctualLight::Kind::directional, .direction = {0, 0, -1}, .intensity = Rgb(3)};
  Gathered gathered({{"floor", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0)},
                     {"pane", {{{-1, -1, 1}, {2, -1, 1}, {2, 2, 1}, {-1, 2, 1}}}, Rgb(0), Rgb(0), true, Rgb(0), Rgb(1)}},
                    Rgb(0), 60, 0, {sun});
  EXPECT_EQ(gathered.of("floor").first, 0);
  PathGatherer gatherer(gathered.tracer, gathered.facets, gathered.patches, gathered.scene, gathered.lamps, Rgb(0), {});
  gatherer.leaveOutFollowed();
  gathered.gather(gatherer, 0);
  addFollowed(gatherer, gathered.patches, 0, 3, gathered.truth);
  EXPECT_NE(gathered.truth.half[0], gathered.truth.half[1]) << "they share no random numbers";
  gathered.expect("floor", 3 * 0.96 / 1.04);  // (1 - R) / (1 + R), where R is 0.04
}

// H* itself has no error; H* with a known error has that one; and what is below the noise is called so.
TEST(GatheringReference, FindsAKnownErrorThroughItsNoise) {
  const Gathered furnace(closedBox({1, 1, 1}, Rgb(0.5), Rgb(1)), Rgb(0), 600, 0.3);
  std::vector<Rgb> exact(furnace.patches.size(), Rgb(2)), wrong = exact;
  const HError none = errorOf(exact, furnace.patches, furnace.truth);
  EXPECT_LT(none.error, 1.5 * none.noise);
  EXPECT_LT(none.noise, none.standardError) << "two halves tell more than one mean";
  for (size_t i = 0; i < wrong.size(); ++i) wrong[i] *= i % 2 == 0 ? 1.1 : 0.9;
  EXPECT_NEAR(errorOf(wrong, furnace.patches, furnace.truth).error, 0.1, 0.01);
}

// Joining patches by a formula, and by solving the joined system with the same F.
TEST(PatchError, IsWhatJoiningDoes) {
  auto surfaces = closedBox({1, 2, 1.5}, Rgb(0.7, 0.5, 0.3));
  surfaces[5].emission = Rgb(1, 2, 0.5);
  surfaces.push_back({"screen", {{{0.2, 0.9, 0}, {0.8, 0.9, 0}, {0.8, 0.9, 0.9}, {0.2, 0.9, 0.9}}}, Rgb(0.4), Rgb(0), true});
  RayOptions options;
  options.rays = 1024;
  RayRun run(loadSurfaces(surfaces), {600, 0}, options);
  run.makeAll();
  SolveOptions o;
  o.residual = 1e-10;
  const Solution fine = solveRadiosity(run.f, run.patches, {}, run.scene, o, Log(true));
  const std::vector<uint32_t> ofCell = joinedCells(run.patches, run.facets, 2);
  std::vector<uint32_t> joined(run.patches.size());
  for (uint32_t p = 0; p < joined.size(); ++p) joined[p] = ofCell[run.patches.cellsOf(p)[0]];
  const JoiningError predicted = joiningError(run.f, run.patches, {}, fine, joined);

  const uint32_t count = 1 + *std::max_element(joined.begin(), joined.end());
  EXPECT_LT(count, run.patches.size() / 3);
  PatchSet coarse = buildPatches(run.scene, run.facets, {600, 0});
  mapCells(coarse, run.scene, run.facets, ofCell);
  ASSERT_EQ(coarse.size(), count);
  FormFactorMatrix f(count);
  std::vector<std::vector<double>> rows(count, std::vector<double>(count));
  std::vector<double> missed(count);
  for (size_t i = 0; i < joined.size(); ++i) {
    const double share = run.patches.patches[i].area / coarse.patches[joined[i]].area;
    run.f[i].forEach([&](size_t j, double value) { rows[joined[i]][joined[j]] += share * value; });
    missed[joined[i]] += share * run.f.shares(i).missed;
  }
  for (uint32_t k = 0; k < count; ++k) {
    std::copy(rows[k].begin(), rows[k].end(), f.row(k).begin());
    RowShares shares;
    shares.missed = missed[k];
    f.finish(k, shares);
  }
  const Solution solved = solveRadiosity(f, coarse, {}, run.scene, o, Log(true));
  std::vector<Rgb> mean(count, Rgb(0));
  for (size_t i = 0; i < joined.size(); ++i)
    mean[joined[i]] += run.patches.patches[i].area / coarse.patches[joined[i]].area * fine.irradiance[i];
  Rgb squares(0), total(0);
  double area = 0;
  for (size_t k = 0; k < count; ++k) {
    const Rgb d = solved.irradiance[k] - mean[k];
    squares += coarse.patches[k].area * d * d;
    total += coarse.patches[k].area * mean[k];
    area += coarse.patches[k].area;
  }
  double found = 0;
  for (int c = 0; c < 3; ++c) found = std::max(found, std::sqrt(squares[c] / area) / (total[c] / area));
  EXPECT_GT(found, 1e-3);
  EXPECT_NEAR(predicted.relative / found, 1, 0.05);
}

}  // namespace
}  // namespace farol::test
