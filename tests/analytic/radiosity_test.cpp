// Solved scenes with known answers. Values: one patch per face with exact factors, dense solves at 30 digits that
// agree with the Neumann series to 1e-13; furnaces, spheres and plates in closed form (sources at each test).
#include "known_radiosity.h"
#include "raster_run.h"
#include "solve/solver.h"

#include <gtest/gtest.h>
#include <map>

namespace farol::test {
namespace {

Solution solved(RasterRun& run, double residual = 1e-9, SolverKind kind = SolverKind::gaussSeidel) {
  run.makeAll();
  SolveOptions o;
  o.residual = residual;
  o.kind = kind;
  return solveRadiosity(run.f, run.patches, {}, run.scene, o, Log(true));
}

// Area-weighted mean radiosity per surface.
std::map<std::string, Rgb> means(const RasterRun& run, const Solution& s) {
  std::map<std::string, Rgb> sums;
  std::map<std::string, double> areas;
  for (size_t i = 0; i < run.patches.size(); ++i) {
    const Patch& p = run.patches.patches[i];
    const std::string name = surfaceNameOf(run.scene, p);
    sums.emplace(name, Rgb(0)).first->second += p.area * s.radiosity[i];
    areas[name] += p.area;
  }
  for (auto& [name, sum] : sums) sum /= areas[name];
  return sums;
}

// Any closed scene with one E and rho: B = E / (1 - rho), for every mesh (truth B1). float32 rows sum to 1 within a few
// 1e-8, which 1 / (1 - rho) = 100 enlarges to a few 1e-6.
TEST(WhiteFurnace, HasTheClosedFormForEveryMesh) {
  for (const size_t count : {size_t{6}, size_t{54}, size_t{63}, size_t{150}, size_t{1000}, size_t{4000}}) {
    for (const Rgb& rho : {Rgb(0, 0.25, 0.5), Rgb(0.8, 0.9, 0.95), Rgb(0.2, 0.5, 0.99)}) {
      RasterRun run(loadSurfaces(closedBox({1, 2, 3}, rho, Rgb(1))), {count, 0}, {});
      const Solution s = solved(run, 1e-7);
      for (size_t i = 0; i < run.patches.size(); ++i) {
        for (int c = 0; c < 3; ++c)
          ASSERT_NEAR(s.radiosity[i][c], 1 / (1 - rho[c]), 1e-5 / (1 - rho[c])) << "N = " << count << ", rho = " << rho[c];
      }
      if (count > 1000 && rho.b > 0.9) break;  // the slowest once
    }
  }
}

// Truth B3b: two facing unit squares in the open, one patch each.
TEST(OpenScene, LosesWhatRowsMiss) {
  const std::vector<TestSurface> plates = {{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0.5), Rgb(1)},
                                           {"2", {{{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}}}, Rgb(0.8), Rgb(0)}};
  RasterOptions options;
  options.resolution = 128;
  options.positions = 64;
  RasterRun run(loadSurfaces(plates), {1, 0}, options);
  const Solution s = solved(run);
  EXPECT_NEAR(s.radiosity[0].r, 1.016231240883946, 0.001);
  EXPECT_NEAR(s.radiosity[1].r, 0.1624546413720618, 0.003 * 0.1625);
  const EnergyBalance e = energyBalance(run.f, run.patches, s, Rgb(0));
  EXPECT_NEAR(e.toOpen.r, 0.943155098773039, 0.003);
}

// Truth B4a: unit cube, one patch per face; channels are independent systems.
TEST(Cube, MatchesTheExactSixPatchSystem) {
  auto box = closedBox({1, 1, 1});
  for (TestSurface& s : box) {
    s.reflectance = Rgb(0.5, 0.8, s.name == "x0" ? 0 : 0.5);
    s.emission = Rgb(s.name == "z1", s.name == "z1", s.name == "x0");
  }
  RasterOptions options;
  options.resolution = 128;
  options.positions = 144;
  RasterRun run(loadSurfaces(box), {6, 0}, options);
  const auto b = means(run, solved(run));
  EXPECT_NEAR(b.at("x0").r, 0.181836268946129, 0.001 * 0.1818);
  EXPECT_NEAR(b.at("z0").r, 0.1817458261077885, 0.001 * 0.1817);
  EXPECT_NEAR(b.at("z1").r, 1.090909098107695, 0.0005);
  EXPECT_NEAR(b.at("y1").g, 0.6896811939043619, 0.001 * 0.69);
  EXPECT_NEAR(b.at("z1").g, 1.551724153644915, 0.0015);
  EXPECT_NEAR(b.at("x0").b, 1.0, 1e-12);
  EXPECT_NEAR(b.at("x1").b, 0.166600339499457, 0.001 * 0.1666);
  EXPECT_NEAR(b.at("z0").b, 0.1666832454340554, 0.001 * 0.1667);
}

TEST(Box, MatchesTheExactSixPatchSystem) {
  RasterOptions options;
  options.resolution = 128;
  options.positions = 144;
  RasterRun run(loadSurfaces(colouredBox()), {0, 100}, options);
  ASSERT_EQ(run.patches.size(), 6u);
  const auto b = means(run, solved(run));
  for (const auto& [name, value] : kColouredBoxRadiosity) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(b.at(name)[c], value[c], 0.002 * value[c]) << name << " channel " << c;
  }
}

// Truth B5a: what meshing alone changes, level by level (m x m cells per face, exact factors).
TEST(Cube, FollowsTheMeshLevels) {
  const std::map<int, std::pair<double, double>> floorAndWall = {{1, {0.181745826108, 0.181836268946}},
                                                                 {2, {0.173639114749, 0.181836268946}},
                                                                 {4, {0.171829422310, 0.181381216327}},
                                                                 {8, {0.171373223526, 0.181195523706}},
                                                                 {16, {0.171255694053, 0.181133371241}}};
  for (const auto& [m, value] : floorAndWall) {
    auto box = closedBox({1, 1, 1});
    box[5].emission = Rgb(1);
    RasterOptions options;
    options.resolution = 128;
    options.positions = m == 1 ? 144 : m == 2 ? 64 : 9;
    RasterRun run(loadSurfaces(box), {0, 1.0 / m}, options);
    ASSERT_EQ(run.patches.size(), static_cast<size_t>(6 * m * m));
    const auto b = means(run, solved(run));
    EXPECT_NEAR(b.at("z0").r, value.first, 0.0015 * value.first) << "level " << m;
    EXPECT_NEAR(b.at("x0").r, value.second, 0.0015 * value.second) << "level " << m;
  }
}

// Truth B6: mean indirect irradiance over all walls is phi rho / (A (1 - rho)), whatever the source. A closed cube of
// 4 m, a source of 10000 lm on the ceiling: E = 10000 / 16.
TEST(ClosedRoom, HasTheMeanIndirectIrradianceOfTheIntegratingRoom) {
  for (const double rho : {0.05, 0.3, 0.7, 0.95}) {
    auto box = closedBox({4, 4, 4}, Rgb(rho));
    box[5].emission = Rgb(10000.0 / 16);
    RasterOptions options;
    options.positions = 4;
    RasterRun run(loadSurfaces(box), {600, 0}, options);
    const Solution s = solved(run);
    double total = 0, direct = 0;
    for (size_t i = 0; i < run.patches.size(); ++i) total += run.patches.patches[i].area * s.irradiance[i].r / 96;
    direct = 10000.0 / 96;  // mean direct irradiance: all of the flux lands somewhere
    const double exact = 10000.0 * rho / (96 * (1 - rho));
    EXPECT_NEAR(total - direct, exact, 0.002 * (exact + direct)) << rho;
  }
}

// Truth B2a: sphere with a black source cap of 2 % (E 10) and a wall of rho 0.9: H = 1.694915 everywhere.
TEST(IntegratingSphere, IsUniformAndHasTheClosedForm) {
  auto zones = sphereZones("zone", 1, true, {-1, -0.96, 1}, 40);
  zones[0].reflectance = Rgb(0);
  zones[0].emission = Rgb(10);
  zones[1].reflectance = Rgb(0.9);
  RasterOptions options;
  options.positions = 4;
  RasterRun run(loadSurfaces(zones), {1000, 0}, options);
  const Solution s = solved(run);
  double flux = 0, area = 0;
  for (size_t i = 0; i < run.patches.size(); ++i) {
    flux += run.patches.patches[i].area * s.irradiance[i].r;
    area += run.patches.patches[i].area;
  }
  EXPECT_NEAR(flux / area, 1.694915254237288, 0.015 * 1.695);  // polyhedron of 40 segments: its cap has 1 % less area
}

// Truth B8: concentric spheres, radius ratio 0.5; inner E 1, rho 0.6, outer rho 0.7.
TEST(ConcentricSpheres, MatchTheClosedForm) {
  auto inner = sphereZones("inner", 0.5, false, {-1, 1}, 24), outer = sphereZones("outer", 1, true, {-1, 1}, 24);
  inner[0].reflectance = Rgb(0.6);
  inner[0].emission = Rgb(1);
  outer[0].reflectance = Rgb(0.7);
  RasterOptions options;
  options.positions = 4;
  RasterRun run(loadSurfaces({inner[0], outer[0]}), {600, 0}, options);
  const auto b = means(run, solved(run));
  // Similar polyhedra keep the area ratio 1/4 and all of the inner's light reaches the outer: the closed form holds for
  // their means up to the unevenness of facets.
  EXPECT_NEAR(b.at("inner").r, 1.2837837837837838, 0.003 * 1.2838);
  EXPECT_NEAR(b.at("outer").r, 0.47297297297297297, 0.003 * 0.473);
}

// Truth B7: closed corridor 1 x 1 x 20, walls in 20 segments, ends one patch each; the end z = 0 emits.
TEST(Corridor, CarriesLightToItsFarEnd) {
  for (const CorridorRadiosity& v : kCorridors) {
    auto box = closedBox({1, 1, 20}, Rgb(v.rho));
    box[4].emission = Rgb(1);
    RasterOptions options;
    options.resolution = 128;
    options.positions = 64;
    RasterRun run(loadSurfaces(box), {0, 1.0}, options);
    ASSERT_EQ(run.patches.size(), 82u);
    const Solution s = solved(run, 1e-9);
    const auto wall = [&](double z) {
      for (const uint32_t i : run.patchesOf("x0")) {
        if (std::abs(run.patches.patches[i].centre.z - z) < 0.1) return s.radiosity[i].r;
      }
      return -1.0;
    };
    EXPECT_NEAR(wall(0.5), v.segment0, 0.003 * v.segment0);
    EXPECT_NEAR(wall(5.5), v.segment5, 0.02 * v.segment5);
    EXPECT_NEAR(wall(10.5), v.segment10, 0.02 * v.segment10);
    EXPECT_NEAR(means(run, s).at("z1").r, v.farEnd, 0.02 * v.farEnd);
  }
}

// Truth B7: sweeps until max|B - B*| < 1e-6 max B*, from closed forms, within one; the contraction of a Jacobi sweep, rho
// itself in a closed scene, within 1 %.
TEST(Corridor, TakesTheKnownNumberOfSweeps) {
  struct Counts {
    double rho;
    size_t jacobi, gaussSeidel;
  };
  for (const Counts& known : {Counts{0.5, 16, 9}, Counts{0.9, 110, 57}, Counts{0.99, 1249, 626}}) {
    auto box = closedBox({1, 1, 20}, Rgb(known.rho));
    box[4].emission = Rgb(1);
    ExactRun run(loadSurfaces(box), {0, 1.0});
    run.makeAll();
    const auto solvedBy = [&](SolverKind kind, double residual, size_t maxSweeps) {
      SolveOptions o;
      o.kind = kind;
      o.residual = residual;
      o.maxSweeps = maxSweeps;
      return solveRadiosity(run.f, run.patches, {}, run.scene, o, Log(true));
    };
    const Solution limit = solvedBy(SolverKind::gaussSeidel, 1e-12, 100000);
    for (const SolverKind kind : {SolverKind::jacobi, SolverKind::gaussSeidel}) {
      const auto errorAfter = [&](size_t sweeps) {
        const Solution s = solvedBy(kind, 1e-14, sweeps);
        double error = 0, largest = 0;
        for (size_t k = 0; k < s.radiosity.size(); ++k) {
          error = std::max(error, std::abs(s.radiosity[k].r - limit.radiosity[k].r));
          largest = std::max(largest, limit.radiosity[k].r);
        }
        return error / largest;
      };
      const size_t sweeps = kind == SolverKind::jacobi ? known.jacobi : known.gaussSeidel;
      EXPECT_LT(errorAfter(sweeps + 1), 1e-6) << known.rho;
      EXPECT_GT(errorAfter(sweeps - 2), 1e-6) << known.rho;
    }
    EXPECT_NEAR(solvedBy(SolverKind::jacobi, 1e-10, 100000).contraction, known.rho, 0.01 * known.rho);
    const Solution residuals = solvedBy(SolverKind::conjugateResiduals, 1e-10, 100000);
    EXPECT_NEAR(residuals.contraction, known.rho, 0.01 * known.rho);
    EXPECT_LT(residuals.sweeps, 150u);
    for (size_t k = 0; k < limit.radiosity.size(); ++k) EXPECT_NEAR(residuals.radiosity[k].r, limit.radiosity[k].r, 1e-9);
  }
}

// Energy: what is emitted is absorbed, as closely as F is reciprocal.
TEST(CornellStyleBox, KeepsItsEnergy) {
  RasterOptions options;
  options.positions = 9;
  options.resolution = 128;
  RasterRun run(loadSurfaces(colouredBox()), {400, 0}, options);
  const Solution s = solved(run);
  EXPECT_LT(energyBalance(run.f, run.patches, s, Rgb(0)).relativeError, 0.001);
}

}  // namespace
}  // namespace farol::test
