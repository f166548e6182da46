// Many lightings on one F, and the places a solve can run.
#include "program.h"
#include "test_scene.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace farol::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

// Two lamps hang in a room; the material of surface x is "paint of x".
class Relighting : public ::testing::Test {
 protected:
  Relighting() {
    room_ = closedBox({2, 3, 2.5}, Rgb(0.5));
    const auto lamp = [](double x) {
      return std::vector<std::vector<Vec3>>{{{x, 1.2, 2.4}, {x, 1.5, 2.4}, {x + 0.3, 1.5, 2.4}, {x + 0.3, 1.2, 2.4}}};
    };
    room_.push_back({"left", lamp(0.3), Rgb(0.2), Rgb(30, 20, 10)});
    room_.push_back({"right", lamp(1.4), Rgb(0.2), Rgb(10, 20, 30)});
    write("room.gltf");
  }
  std::string path(const std::string& name) const { return folder_.path(name); }
  void write(const std::string& name) const { writeText(path(name), gltfOf(room_).dump()); }
  TestSurface& surface(const std::string& name) {
    return *std::find_if(room_.begin(), room_.end(), [&](const TestSurface& s) { return s.name == name; });
  }
  void solve(const std::string& scene, const std::string& options) const {
    const Outcome o = farol("solve " + path(scene) + " --patches 600 --rays 256 --residual 1e-8 " + options);
    EXPECT_EQ(o.exitCode, 0) << o.err;
  }
  // Red, green and blue of H per patch, and err.
  std::vector<double> column(const std::string& csv, size_t place) const {
    std::vector<double> values;
    const auto lines = readCsv(path(csv));
    for (size_t k = 1; k < lines.size(); ++k) values.push_back(std::stod(lines[k].at(place)));
    return values;
  }
  void expectRefused(const std::string& variants, const std::string& sentence) const {
    writeText(path("bad.json"), variants);
    const Outcome o = farol("solve " + path("room.gltf") + " --variants " + path("bad.json") + " --patches-csv " + path("bad.csv"));
    EXPECT_EQ(o.exitCode, 1) << variants;
    EXPECT_THAT(o.err, HasSubstr("bad.json"));
    EXPECT_THAT(o.err, HasSubstr(sentence));
  }

  TemporaryFolder folder_;
  std::vector<TestSurface> room_;
};

// Six settings of two lamps from three unit solutions, each as its own scene would give; one with new paint is solved.
TEST_F(Relighting, GivesWhatScenesOfTheirOwnGive) {
  json variants = json::array();
  for (int k = 0; k < 6; ++k) {
    variants.push_back({{"name", fmt::format("v{}", k)}, {"materials", {{"paint of left", {{"emission", {k, 2 * k, 3}}}}}}});
    if (k % 2 == 1) variants.back()["materials"]["paint of right"] = {{"emission", {0, 7, 0}}};
  }
  variants.push_back(
      {{"name", "painted"},
       {"materials", {{"paint of x0", {{"diffuse", {0.9, 0.1, 0.2}}}}, {"paint of left", {{"emission", {1, 1, 1}}}}}}});
  writeText(path("variants.json"), variants.dump());
  for (const char* emitters : {"matrix", "apart"}) {
    const std::string how = std::string("--emitters ") + emitters;
    solve("room.gltf", how + " --variants " + path("variants.json") + " --patches-csv " + path("p.csv") + " -o " + path("lit.glb") +
                           " --report " + path("report.json"));
    const json report = json::parse(readText(path("report.json")));
    ASSERT_EQ(report["variants"].size(), 7u);
    for (const json& v : report["variants"]) {
      const std::string name = v["name"];
      EXPECT_EQ(v["unit_solutions"], name == "painted" ? 0 : 3);
      const json& materials = variants[name == "painted" ? 6 : static_cast<size_t>(name[1] - '0')]["materials"];
      auto before = room_;
      for (const auto& [material, change] : materials.items()) {
        for (const auto& [key, value] : change.items())
          (key == "emission" ? surface(material.substr(9)).emission : surface(material.substr(9)).reflectance) =
              Rgb(value[0], value[1], value[2]);
      }
      write("own.gltf");
      room_ = before;
      solve("own.gltf", how + " --patches-csv " + path("own.csv"));
      const auto err = column("own.csv", 22), combinedErr = column(fmt::format("p.{}.csv", name), 22);
      for (const size_t channel : {size_t{18}, size_t{19}, size_t{20}}) {
        const auto own = column("own.csv", channel), got = column(fmt::format("p.{}.csv", name), channel);
        ASSERT_EQ(own.size(), got.size());
        size_t outside = 0;
        for (size_t i = 0; i < own.size(); ++i) {
          // With lamps in F the same linear system; apart, the same up to the noise of shadow rays.
          if (std::string(emitters) == "matrix") {
            EXPECT_NEAR(got[i], own[i], 1e-5 * (0.1 + own[i])) << name << " " << i;
          }
          if (std::abs(got[i] - own[i]) > 3 * (err[i] + combinedErr[i])) ++outside;
        }
        EXPECT_LE(outside, own.size() / 50) << name;
      }
      EXPECT_GT(readText(path(fmt::format("lit.{}.glb", name))).size(), 1000u);
    }
  }
}

TEST_F(Relighting, RefusesVariantsThatMeanNothing) {
  expectRefused("{", "this is not JSON");
  expectRefused("{}", "a list");
  expectRefused("[3]", "variant 1 is number");
  expectRefused(R"([{"materials":{"sun":{"emission":[1,1,1]}}}])", "the scene has no material 'sun'");
  expectRefused(R"([{"materials":{"paint of left":{"emission":[1,-1,1]}}}])", "material 'paint of left': emission is [1,-1,1]");
  expectRefused(R"([{"materials":{"paint of left":{"diffuse":[1.5,1,1]}}}])", "add up to 1.5");
  expectRefused(R"([{"materials":{"paint of left":{"gloss":[1,1,1]}}}])", "'gloss' is not known");
  expectRefused(R"([{"name":"a"},{"name":"a"}])", "two variants are called 'a'");
  expectRefused(R"([{"name":"../a"}])", "cannot be part of a file's name");
  EXPECT_THAT(folder_.files(), ::testing::Not(::testing::Contains(HasSubstr(".csv"))));
}

TEST_F(Relighting, SolvesOnTheDeviceAsOnTheCpu) {
  for (const char* on : {"cpu", "gpu"})
    solve("room.gltf", std::string("--solve-on ") + on + " --patches-csv " + path(fmt::format("{}.csv", on)) + " --report " +
                           path("report.json"));
  const auto here = column("cpu.csv", 18), there = column("gpu.csv", 18);
  ASSERT_EQ(here.size(), there.size());
  for (size_t i = 0; i < here.size(); ++i) EXPECT_NEAR(here[i], there[i], 1e-6 * here[i]);
  const json report = json::parse(readText(path("report.json")));
  EXPECT_NE(report["solve"]["on"], "CPU");
  EXPECT_EQ(report["solve"]["why"], "asked for");
  EXPECT_EQ(report["solve"]["history"].size(), report["solve"]["sweeps"].get<size_t>() + 1);
  EXPECT_EQ(farol("solve " + path("room.gltf") + " --solve-on gpu --solver gauss-seidel").exitCode, 2);
  const Outcome o = farol("compare " + path("room.gltf") + " gpu cpu --patches 300 --rays 256 --report " + path("c.json"));
  EXPECT_EQ(o.exitCode, 0) << o.err;
  EXPECT_LT(json::parse(readText(path("c.json")))["solver_comparison"]["rms"], 1e-5);
  EXPECT_EQ(farol("compare " + path("room.gltf") + " gpu rays:64").exitCode, 2);
}

// Less memory than float32 needs: 16 bits, said with what they change; and a refusal where that is not enough either.
TEST_F(Relighting, StoresFAsSmallAsMemoryAsks) {
  const std::string how = "solve " + path("room.gltf") + " --patches 1000 --rays 4096 --residual 1e-8 --patches-csv ";
  ASSERT_EQ(farol(how + path("full.csv")).exitCode, 0);
  const Outcome small = farol(how + path("small.csv") + " --memory 3M --report " + path("report.json"));
  EXPECT_EQ(small.exitCode, 0) << small.err;
  EXPECT_THAT(small.out, HasSubstr("rows in 16 bits"));
  const json storage = json::parse(readText(path("report.json")))["storage"];
  EXPECT_EQ(storage["rows_float32"], 0);
  EXPECT_GT(storage["rows_16_bit"], 500);
  const double told = storage["row_l1_error_by_16_bit"];
  EXPECT_GT(told, 0);
  const auto full = column("full.csv", 18), packed = column("small.csv", 18);
  double most = 0, mean = 0;
  for (size_t i = 0; i < full.size(); ++i) {
    most = std::max(most, std::abs(full[i] - packed[i]));
    mean += full[i] / static_cast<double>(full.size());
  }
  EXPECT_GT(most, 0);
  EXPECT_LT(most, 10 * told * mean);
  const Outcome none = farol(how + path("none.csv") + " --memory 1M");
  EXPECT_EQ(none.exitCode, 1);
  EXPECT_THAT(none.err, HasSubstr("GB in 16 bits"));
}

TEST_F(Relighting, WarnsWhereLittleIsAbsorbed) {
  for (TestSurface& s : room_) s.reflectance = Rgb(0.995);
  write("white.gltf");
  const Outcome o = farol("solve " + path("white.gltf") + " --patches 200");
  EXPECT_EQ(o.exitCode, 0);
  EXPECT_THAT(o.err, HasSubstr("reflectance times row sum reaches 0.9950"));
}

// White furnace at several sizes, by every method and place of the solve: B = E / (1 - rho).
TEST(WhiteFurnace, HoldsAtEverySizeUpToReflectance0999) {
  const TemporaryFolder folder;
  for (const double rho : {0.5, 0.99, 0.999}) {
    writeText(folder.path("furnace.gltf"), gltfOf(closedBox({1, 2, 1.5}, Rgb(rho), Rgb(1))).dump());
    for (const char* how :
         {"--patches 6 --rays 256", "--patches 100 --rays 4096", "--patches 1500 --rays 256", "--patches 600 --method raster",
          "--patches 600 --rays 1024 --solve-on gpu", "--patches 700 --rays 4096 --memory 2M"}) {
      const Outcome o = farol("solve " + folder.path("furnace.gltf") + " " + how + " --patches-csv " + folder.path("p.csv"));
      ASSERT_EQ(o.exitCode, 0) << o.err;
      const auto lines = readCsv(folder.path("p.csv"));
      const double exact = 1 / (1 - rho), tolerance = rho > 0.99 ? 1e-4 : 1e-5;
      for (size_t k = 1; k < lines.size(); ++k)
        ASSERT_NEAR(std::stod(lines[k].at(15)), exact, tolerance * exact) << rho << " " << how;
    }
  }
}

}  // namespace
}  // namespace farol::test
