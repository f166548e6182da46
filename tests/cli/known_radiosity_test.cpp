// Scenes of known radiosity by the program itself with everything on: near field, emitters apart, covered area. The
// same answers as tests/analytic/radiosity_test.cpp (sources there), within the same bounds, by rays and by raster.
#include "known_radiosity.h"

#include "program.h"
#include "test_scene.h"

#include <cmath>
#include <gmock/gmock.h>
#include <map>

namespace farol::test {
namespace {

struct Means {
  std::map<std::string, Rgb> b;           // per surface, area-weighted
  std::map<double, double> wallByHeight;  // mean B of the four walls by z in halves, red
  double h = 0;                           // over everything, red
  size_t patches = 0;
};

class KnownRadiosity : public ::testing::TestWithParam<const char*> {
 protected:
  // Few patches take more rays: a row's error is that of its rays alone.
  Means solve(const std::vector<TestSurface>& scene, std::string patches) const {
    if (std::string(GetParam()).find("rays") != std::string::npos)
      patches += patches.starts_with("--patch-size") && patches.size() < 17 ? " --rays 262144" : " --rays 16384";
    const TemporaryFolder folder;
    writeText(folder.path("s.gltf"), gltfOf(scene).dump());
    const Outcome o = farol("solve " + folder.path("s.gltf") + " " + patches + " " + GetParam() +
                            " --residual 1e-8 --patches-csv " + folder.path("p.csv"));
    EXPECT_EQ(o.exitCode, 0) << o.err;
    Means m;
    std::map<std::string, double> areas;
    double area = 0;
    const auto lines = readCsv(folder.path("p.csv"));
    for (size_t k = 1; k < lines.size(); ++k) {
      const auto number = [&](size_t column) { return std::stod(lines[k].at(column)); };
      const double a = number(8);
      const std::string& name = lines[k][1];
      m.b.emplace(name, Rgb(0)).first->second += a * Rgb(number(15), number(16), number(17));
      areas[name] += a;
      m.h += a * number(18);
      area += a;
      if (name[0] != 'z') m.wallByHeight[std::round(2 * number(4)) / 2] += number(15) / 4;
    }
    for (auto& [name, sum] : m.b) sum /= areas[name];
    m.h /= area;
    m.patches = lines.size() - 1;
    return m;
  }
};

// Truth B3b.
TEST_P(KnownRadiosity, OfTwoPlatesInTheOpen) {
  const Means m = solve({{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0.5), Rgb(1)},
                         {"2", {{{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}}}, Rgb(0.8), Rgb(0)}},
                        "--patch-size 2");
  ASSERT_EQ(m.patches, 2u);
  EXPECT_NEAR(m.b.at("1").r, 1.016231240883946, 0.001);
  EXPECT_NEAR(m.b.at("2").r, 0.1624546413720618, 0.003 * 0.1625);
}

// Truth B4a, one patch per face.
TEST_P(KnownRadiosity, OfTheCube) {
  auto box = closedBox({1, 1, 1});
  for (TestSurface& s : box) {
    s.reflectance = Rgb(0.5, 0.8, s.name == "x0" ? 0 : 0.5);
    s.emission = Rgb(s.name == "z1", s.name == "z1", s.name == "x0");
  }
  const Means m = solve(box, "--patch-size 2");
  ASSERT_EQ(m.patches, 6u);
  EXPECT_NEAR(m.b.at("x0").r, 0.181836268946129, 0.001 * 0.1818);
  EXPECT_NEAR(m.b.at("z0").r, 0.1817458261077885, 0.001 * 0.1817);
  EXPECT_NEAR(m.b.at("z1").r, 1.090909098107695, 0.0005);
  EXPECT_NEAR(m.b.at("y1").g, 0.6896811939043619, 0.001 * 0.69);
  EXPECT_NEAR(m.b.at("z1").g, 1.551724153644915, 0.0015);
  EXPECT_NEAR(m.b.at("x0").b, 1.0, 1e-12);
  EXPECT_NEAR(m.b.at("x1").b, 0.166600339499457, 0.001 * 0.1666);
  EXPECT_NEAR(m.b.at("z0").b, 0.1666832454340554, 0.001 * 0.1667);
}

// Truth B4b, one patch per face.
TEST_P(KnownRadiosity, OfTheColouredBox) {
  const Means m = solve(colouredBox(), "--patch-size 100");
  ASSERT_EQ(m.patches, 6u);
  for (const auto& [name, value] : kColouredBoxRadiosity) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(m.b.at(name)[c], value[c], 0.002 * value[c]) << name << " channel " << c;
  }
}

// Truth B5a, mesh levels 4 and 16.
TEST_P(KnownRadiosity, OfFinerCubes) {
  auto box = closedBox({1, 1, 1});
  box[5].emission = Rgb(1);
  const Means four = solve(box, "--patch-size 0.25"), sixteen = solve(box, "--patch-size 0.0625");
  ASSERT_EQ(sixteen.patches, 1536u);
  EXPECT_NEAR(four.b.at("z0").r, 0.171829422310, 0.0015 * 0.1718);
  EXPECT_NEAR(four.b.at("x0").r, 0.181381216327, 0.0015 * 0.1814);
  EXPECT_NEAR(sixteen.b.at("z0").r, 0.171255694053, 0.0015 * 0.1713);
  EXPECT_NEAR(sixteen.b.at("x0").r, 0.181133371241, 0.0015 * 0.1811);
}

// Truth B6: mean indirect irradiance phi rho / (A (1 - rho)); mean direct irradiance phi / A.
TEST_P(KnownRadiosity, OfTheIntegratingRoom) {
  for (const double rho : {0.05, 0.7, 0.95}) {
    auto box = closedBox({4, 4, 4}, Rgb(rho));
    box[5].emission = Rgb(625);
    const double direct = 10000.0 / 96;
    EXPECT_NEAR(solve(box, "--patches 600").h, direct / (1 - rho), 0.002 * direct / (1 - rho)) << rho;
  }
}

// Truth B2a and B8: spheres as polyhedra, whose unevenness the bounds allow.
TEST_P(KnownRadiosity, OfSpheres) {
  auto zones = sphereZones("zone", 1, true, {-1, -0.96, 1}, 40);
  zones[0].reflectance = Rgb(0);
  zones[0].emission = Rgb(10);
  zones[1].reflectance = Rgb(0.9);
  EXPECT_NEAR(solve(zones, "--patches 1000").h, 1.694915254237288, 0.015 * 1.695);
  auto inner = sphereZones("inner", 0.5, false, {-1, 1}, 24), outer = sphereZones("outer", 1, true, {-1, 1}, 24);
  inner[0].reflectance = Rgb(0.6);
  inner[0].emission = Rgb(1);
  outer[0].reflectance = Rgb(0.7);
  const Means m = solve({inner[0], outer[0]}, "--patches 600");
  EXPECT_NEAR(m.b.at("inner").r, 1.2837837837837838, 0.003 * 1.2838);
  EXPECT_NEAR(m.b.at("outer").r, 0.47297297297297297, 0.003 * 0.473);
}

// Truth B7a and B7c: segments one unit long, the end z = 0 emits.
TEST_P(KnownRadiosity, OfCorridors) {
  for (const CorridorRadiosity& v : kCorridors) {
    auto box = closedBox({1, 1, 20}, Rgb(v.rho));
    box[4].emission = Rgb(1);
    const Means m = solve(box, "--patch-size 1");
    ASSERT_EQ(m.patches, 82u);
    EXPECT_NEAR(m.wallByHeight.at(0.5), v.segment0, 0.003 * v.segment0);
    EXPECT_NEAR(m.wallByHeight.at(5.5), v.segment5, 0.02 * v.segment5);
    EXPECT_NEAR(m.wallByHeight.at(10.5), v.segment10, 0.02 * v.segment10);
    EXPECT_NEAR(m.b.at("z1").r, v.farEnd, 0.02 * v.farEnd);
  }
}

INSTANTIATE_TEST_SUITE_P(ByRays, KnownRadiosity, ::testing::Values("--method rays"));
INSTANTIATE_TEST_SUITE_P(ByRaster, KnownRadiosity, ::testing::Values("--method raster --resolution 128"));

}  // namespace
}  // namespace farol::test
