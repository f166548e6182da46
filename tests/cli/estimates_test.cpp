// The errors that the program states against the errors that it makes, over scenes with known answers. A stated L1
// error of a row must cover the true one in 95 of 100 rows, two stated standard errors of a patch's irradiance in 95 of
// 100 patches; and what is stated must not be more than 3 times the true error in the median.
#include "program.h"
#include "test_scene.h"
#include "truth_cases.h"

#include <cmath>
#include <gmock/gmock.h>
#include <map>

namespace farol::test {
namespace {

using nlohmann::json;

struct Errors {
  std::vector<double> stated, made;

  void add(double s, double m) {
    stated.push_back(s);
    made.push_back(m);
  }
  static double median(std::vector<double> v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  }
  double coverage(double times) const {
    double covered = 0;
    for (size_t k = 0; k < stated.size(); ++k) covered += times * stated[k] >= made[k] ? 1 : 0;
    return covered / static_cast<double>(stated.size());
  }
  double excess() const { return median(stated) / median(made); }
};

// `times` the stated error must cover.
void expectHonest(const Errors& e, double times, const std::string& what) {
  EXPECT_GE(e.coverage(times), 0.95) << what;
  EXPECT_LE(e.excess(), 3.0) << what;
  EXPECT_GE(e.excess(), 0.5) << what;
  std::printf("%s: %zu cases, %.3f covered, stated median %.2f times the true one\n", what.c_str(), e.stated.size(),
              e.coverage(times), e.excess());
}

// Rows of all unoccluded cases against closed forms.
void compareRows(const std::string& method, const std::string& what) {
  Errors errors;
  const TemporaryFolder folder;
  for (size_t k = 0; k < truthCases().size(); ++k) {
    const TruthCase truth(k);
    if (!truth.onlyPolygons() || truth.id().starts_with("A15") || truth.id().starts_with("A16")) continue;
    writeText(folder.path("s.gltf"), gltfOf(truth.surfaces(4)).dump());
    const Outcome o =
        farol("compare " + folder.path("s.gltf") + " " + method + " exact --patches 150 --report " + folder.path("r.json"));
    ASSERT_EQ(o.exitCode, 0) << o.err;
    const json r = json::parse(readText(folder.path("r.json")));
    for (const json& row : r["comparison"]["rows_l1_max_estimate"]) errors.add(row[2], row[0]);
  }
  expectHonest(errors, 1, what);
}

TEST(StatedErrors, OfRowsByFewRays) { compareRows("rays:256", "rows, rays:256"); }
TEST(StatedErrors, OfRowsByManyRays) { compareRows("rays:4096", "rows, rays:4096"); }
TEST(StatedErrors, OfRowsByRaster) { compareRows("raster:64", "rows, raster:64"); }

struct Line {
  std::array<double, 3> h;
  double err;
};

std::vector<Line> solve(const std::string& scene, const std::string& options, const TemporaryFolder& folder) {
  const Outcome o = farol("solve " + scene + " " + options + " --residual 1e-6 --patches-csv " + folder.path("p.csv"));
  EXPECT_EQ(o.exitCode, 0) << o.err;
  std::vector<Line> lines;
  const auto table = readCsv(folder.path("p.csv"));
  for (size_t k = 1; k < table.size(); ++k) {
    const auto number = [&](size_t column) { return std::stod(table[k].at(column)); };
    lines.push_back({{number(18), number(19), number(20)}, number(22)});
  }
  return lines;
}

struct LitScene {
  std::string name;
  std::vector<TestSurface> surfaces;
  bool open = true;  // nothing can block: closed forms are the reference, otherwise 65,536 rays
};

// The scenes of known radiosity: boxes, furnace rooms, corridors, plates, spheres; and a lamp below a ceiling.
std::vector<LitScene> litScenes() {
  std::vector<LitScene> scenes;
  auto cube = closedBox({1, 1, 1});
  cube[5].emission = Rgb(1);
  scenes.push_back({"cube", cube});
  scenes.push_back({"coloured box", colouredBox()});
  for (const double r : {0.3, 0.95}) {
    auto room = closedBox({4, 4, 4}, Rgb(r));
    room[5].emission = Rgb(625);
    scenes.push_back({"integrating room", room});
  }
  for (const double r : {0.5, 0.9, 0.99}) {
    auto corridor = closedBox({1, 1, 20}, Rgb(r));
    corridor[4].emission = Rgb(1);
    scenes.push_back({"corridor", corridor});
  }
  scenes.push_back({"plates",
                    {{"1", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0.5), Rgb(1)},
                     {"2", {{{0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1}}}, Rgb(0.8), Rgb(0)}}});
  auto sphere = sphereZones("zone", 1, true, {-1, -0.96, 1}, 24);
  sphere[0].reflectance = Rgb(0);
  sphere[0].emission = Rgb(10);
  sphere[1].reflectance = Rgb(0.9);
  scenes.push_back({"integrating sphere", sphere, false});
  auto inner = sphereZones("inner", 0.5, false, {-1, 1}, 16), outer = sphereZones("outer", 1, true, {-1, 1}, 16);
  inner[0].reflectance = Rgb(0.6);
  inner[0].emission = Rgb(1);
  outer[0].reflectance = Rgb(0.7);
  scenes.push_back({"concentric spheres", {inner[0], outer[0]}, false});
  auto room = closedBox({4, 4, 2.7}, Rgb(0.5, 0.7, 0.8));
  room.push_back({"lamp", {{{1.8, 1.8, 2.69}, {1.8, 2.2, 2.69}, {2.2, 2.2, 2.69}, {2.2, 1.8, 2.69}}}, Rgb(0), Rgb(50, 40, 30)});
  scenes.push_back({"lamp", room, false});
  return scenes;
}

// Irradiance of patches against the same patches with closed forms for F, or, where the lamp may block, 65,536 rays.
void compareIrradiance(const std::string& options, size_t patches, const std::string& what) {
  Errors errors;
  const TemporaryFolder folder;
  for (const LitScene& lit : litScenes()) {
    const std::string scene = folder.path("s.gltf"), count = " --patches " + std::to_string(patches);
    writeText(scene, gltfOf(lit.surfaces).dump());
    static std::map<std::string, std::vector<Line>> references;  // by scene and count, for all methods
    std::vector<Line>& exact = references[gltfOf(lit.surfaces).dump() + count];
    if (exact.empty())
      exact = solve(
          scene, (lit.open ? "--method exact --emitters matrix" : "--method rays --rays 65536 --shadow-rays 4096") + count, folder);
    const auto found = solve(scene, options + count, folder);
    ASSERT_EQ(exact.size(), found.size());
    double mean = 0;  // scenes count alike whatever their brightness
    for (const Line& line : exact) mean += line.h[0] / static_cast<double>(exact.size());
    for (size_t i = 0; i < exact.size(); ++i) {
      double worst = 0;
      for (size_t c = 0; c < 3; ++c) worst = std::max(worst, std::abs(exact[i].h[c] - found[i].h[c]));
      errors.add(found[i].err / mean, worst / mean);
    }
  }
  expectHonest(errors, 2, what);
}

// Outer sides that no light reaches are left out after the rows that tell errors were made: what these tell is the same.
TEST(StatedErrors, OfHemicubesAreThoseOfThePatchesThatAreKept) {
  const TemporaryFolder folder;
  const auto median = [&](bool twoSided) {
    auto box = closedBox({1, 1.2, 0.9}, Rgb(0.5), Rgb(0));
    box[5].emission = Rgb(1);
    for (TestSurface& s : box) s.twoSided = twoSided;
    writeText(folder.path("s.gltf"), gltfOf(box).dump());
    std::vector<double> errors;
    for (const Line& line :
         solve(folder.path("s.gltf"), "--method raster --resolution 16 --emitters matrix --patches 600", folder)) {
      if (line.h[0] > 0) errors.push_back(line.err);
    }
    EXPECT_GT(errors.size(), 500u);
    return Errors::median(errors);
  };
  const double one = median(false), two = median(true);
  EXPECT_GT(one, 0);
  EXPECT_NEAR(two, one, 0.2 * one);
}

TEST(StatedErrors, OfIrradianceByRays) { compareIrradiance("--method rays", 400, "irradiance, rays:256"); }
TEST(StatedErrors, OfIrradianceWithEmittersInF) {
  compareIrradiance("--method rays --emitters matrix", 400, "irradiance, rays:4096, matrix");
}
TEST(StatedErrors, OfIrradianceByRaster) { compareIrradiance("--method raster", 400, "irradiance, raster:64"); }

}  // namespace
}  // namespace farol::test
