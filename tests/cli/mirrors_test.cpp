// Mirrors and glass as users meet them: lamps apart, coloured mirrors, kept factors, refusals, the picture.
#include "program.h"
#include "test_scene.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace farol::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

// A lamp under the ceiling, half hidden by a screen from the floor, and a mirror for a wall.
class Mirrors : public ::testing::Test {
 protected:
  Mirrors() {
    room_ = closedBox({2, 3, 2.5}, Rgb(0.5));
    room_[0].reflectance = Rgb(0.1);
    room_[0].mirror = Rgb(0.8);
    room_.push_back({"lamp", {{{0.8, 1.2, 2.4}, {0.8, 1.8, 2.4}, {1.2, 1.8, 2.4}, {1.2, 1.2, 2.4}}}, Rgb(0), Rgb(50)});
    room_.push_back({"screen", {{{0.6, 1, 2}, {1.6, 1, 2}, {1.6, 2, 2}, {0.6, 2, 2}}}, Rgb(0.3), Rgb(0), true});
    write();
  }
  std::string path(const std::string& name) const { return folder_.path(name); }
  void write() const { writeText(path("room.gltf"), gltfOf(room_).dump()); }
  // With a point light of 10 candela.
  void writeWithCandle(const std::vector<TestSurface>& room) const {
    json j = gltfOf(room);
    j["extensionsUsed"] = {"KHR_lights_punctual"};
    j["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}, {"intensity", 10}}};
    j["nodes"].push_back({{"translation", {0.5, 1.5, 1.5}}, {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
    j["scenes"][0]["nodes"].push_back(j["nodes"].size() - 1);
    writeText(path("room.gltf"), j.dump());
  }
  // Area-weighted mean and rms of a column, and the whole column.
  struct Column {
    std::vector<double> values;
    double mean = 0;
  };
  Column solve(const std::string& how, size_t column = 18) const {
    const Outcome o =
        farol("solve " + path("room.gltf") + " " + how + " --patches-csv " + path("p.csv") + " --report " + path("r.json"));
    EXPECT_EQ(o.exitCode, 0) << o.err;
    EXPECT_EQ(o.err.find("warning"), std::string::npos) << o.err;
    Column c;
    double area = 0;
    const auto lines = readCsv(path("p.csv"));
    for (size_t k = 1; k < lines.size(); ++k) {
      const double a = std::stod(lines[k].at(8));
      c.values.push_back(std::stod(lines[k].at(column)));
      c.mean += a * c.values.back();
      area += a;
    }
    c.mean /= area;
    return c;
  }
  json report() const { return json::parse(readText(path("r.json"))); }

  TemporaryFolder folder_;
  std::vector<TestSurface> room_;
};

// Light that reaches a patch only through the mirror is neither lost nor counted twice: lamps apart and in F agree, by
// rays and by hybrid, and energy is kept.
TEST_F(Mirrors, LampsApartLoseNothing) {
  const Column matrix = solve("--patches 400 --emitters matrix --rays 65536");
  EXPECT_LT(report()["energy"]["relative_error"], 0.005);
  // With 1,024 rays and 64 shadow rays the energy scatters by 0.5 % from seed to seed, with these by 0.1 %.
  for (const char* how : {"--rays 4096 --shadow-rays 1024", "--method hybrid --positions 4 --shadow-rays 1024",
                          "--method raster --positions 4 --shadow-rays 1024"}) {
    const Column apart = solve(std::string("--patches 400 --emitters apart ") + how);
    EXPECT_EQ(report()["light"]["lamps_apart"], 1);
    EXPECT_NEAR(apart.mean, matrix.mean, 0.01 * matrix.mean) << how;
    double squares = 0, told = 0;
    const Column err = solve(std::string("--patches 400 --emitters apart ") + how, 22);
    for (size_t k = 0; k < matrix.values.size(); ++k) {
      squares += std::pow(apart.values[k] - matrix.values[k], 2);
      told += err.values[k] * err.values[k];
    }
    EXPECT_LT(squares, 9 * told + 0.0001 * matrix.mean * matrix.mean * static_cast<double>(matrix.values.size())) << how;
    EXPECT_LT(report()["energy"]["relative_error"], 0.005) << how;
    EXPECT_GT(report()["shares"]["met_specular_first"], 0.05);
  }
}

// Two mirrors face each other: a hundred images of the lamp, or light that is followed from it, on patches of many sizes. Both
// bring all of the light, and each patch as much as the other says.
TEST_F(Mirrors, ShowEveryImageToPatchesOfAllSizes) {
  std::array<std::vector<std::vector<std::string>>, 2> lines;
  for (const size_t k : {size_t{0}, size_t{1}}) {  // no more images than shadow rays
    const Outcome o =
        farol(fmt::format("solve {}/mirrors_and_glass/facing_mirrors.gltf --patch-size 2.8 --adapt 0.02 --method rays --rays 1024 "
                          "--shadow-rays {} --patches-csv {} --report {}",
                          FAROL_SCENES, k == 0 ? 512 : 128, path("p.csv"), path("r.json")));
    ASSERT_EQ(o.exitCode, 0) << o.err;
    EXPECT_LT(report()["energy"]["relative_error"], 0.002);
    lines[k] = readCsv(path("p.csv"));
  }
  ASSERT_EQ(lines[0].size(), lines[1].size());
  double squares = 0, total = 0, area = 0;
  for (size_t k = 1; k < lines[0].size(); ++k) {
    const double a = std::stod(lines[0][k].at(21)), h = std::stod(lines[0][k].at(18));
    squares += a * std::pow(h - std::stod(lines[1][k].at(18)), 2);
    total += a * h;
    area += a;
  }
  EXPECT_LT(std::sqrt(squares / area), 0.012 * total / area);
}

// A mirror that is half red: three F, and each channel is what a mirror of that reflectance gives all channels.
TEST_F(Mirrors, ColouredOnesGiveEachChannelItsOwnF) {
  const Rgb colour(0.8, 0.4, 0.0);
  room_[0].mirror = colour;
  write();
  const std::string how = "--patches 300 --rays 1024 --emitters matrix";
  std::array<Column, 3> got;
  for (size_t c = 0; c < 3; ++c) got[c] = solve(how, 18 + c);
  EXPECT_TRUE(report()["three_form_factors"]);
  EXPECT_LT(report()["energy"]["relative_error"], 0.01);
  ASSERT_EQ(farol("factors " + path("room.gltf") + " --patches 300 --rays 1024 -o " + path("F.npz")).exitCode, 0);
  for (size_t c = 0; c < 3; ++c) {
    const Column kept = solve("--emitters matrix --factors " + path("F.npz"), 18 + c);
    ASSERT_EQ(kept.values.size(), got[c].values.size());
    for (size_t k = 0; k < kept.values.size(); ++k) EXPECT_NEAR(kept.values[k], got[c].values[k], 1e-4 * (0.1 + got[c].values[k]));
  }
  for (size_t c = 0; c < 3; ++c) {
    room_[0].mirror = Rgb(colour[static_cast<int>(c)]);
    write();
    const Column alike = solve(how, 18 + c);
    EXPECT_FALSE(report()["three_form_factors"]);
    for (size_t k = 0; k < alike.values.size(); ++k)
      EXPECT_NEAR(alike.values[k], got[c].values[k], 1e-5 * (0.1 + got[c].values[k])) << c;
  }
  // So is the error of what only green light knows.
  room_[6].emission = Rgb(0, 50, 0);
  const auto estimated = [&](const Rgb& mirror) {
    room_[0].mirror = mirror;
    write();
    solve(how);
    return report()["estimated_error"].get<double>();
  };
  const double alike = estimated(Rgb(colour.g)), coloured = estimated(colour);
  EXPECT_GT(alike, 0);
  EXPECT_NEAR(coloured, alike, 1e-3 * alike);
}

TEST_F(Mirrors, AreRefusedWhereTheyCannotBeFollowed) {
  room_.resize(6);  // nothing blocks
  write();
  for (const char* how : {"factors ROOM --method exact", "compare ROOM exact rays:64"}) {
    std::string text = how;
    text.replace(text.find("ROOM"), 4, path("room.gltf"));
    const Outcome o = farol(text);
    EXPECT_EQ(o.exitCode, 1);
    EXPECT_THAT(o.err, HasSubstr("surface 'x0' is a mirror or clear glass"));
    EXPECT_THAT(o.err, HasSubstr("use rays, hybrid or, for planar mirrors, raster"));
  }
  room_[0].mirror = Rgb(0);
  room_[0].transmission = Rgb(0.5);
  room_[5].emission = Rgb(1);
  write();
  const Outcome o = farol("solve " + path("room.gltf") + " --method raster --patches 100 -o " + path("lit.glb"));
  EXPECT_EQ(o.exitCode, 1);
  EXPECT_THAT(o.err, HasSubstr("surface 'x0' is clear glass, which --method raster cannot mirror; use rays or hybrid"));
  EXPECT_THAT(folder_.files(), ::testing::Not(::testing::Contains("lit.glb")));
  room_[0].transmission = Rgb(0);
  room_.push_back(bumpyBall(1500, {1, 1.5, 1.2}));
  room_.back().reflectance = Rgb(0);
  room_.back().mirror = Rgb(0.9);
  write();
  const Outcome ball = farol("solve " + path("room.gltf") + " --method raster --patches 100 -o " + path("lit.glb"));
  EXPECT_EQ(ball.exitCode, 1);
  EXPECT_THAT(ball.err, HasSubstr("mirrors lie in more than 1024 planes, which --method raster cannot mirror; use rays or hybrid"));
}

// Limits of paths are counted as cut, and energy still adds up.
TEST_F(Mirrors, TellWhatTheirLimitsCut) {
  solve("--patches 200 --rays 1024 --max-depth 0");
  EXPECT_GT(report()["shares"]["cut"], 0.05);
  EXPECT_LT(report()["energy"]["relative_error"], 0.01);
  solve("--patches 200 --rays 1024");
  EXPECT_LT(report()["shares"]["cut"], 1e-4);
}

// Sensors in a furnace whose ceiling is a mirror read what they read without it: B is the same everywhere.
TEST_F(Mirrors, ShowSensorsWhatTheyReflect) {
  auto furnace = closedBox({1, 2, 1.5}, Rgb(0.5), Rgb(1));
  furnace[5].reflectance = furnace[5].emission = Rgb(0);
  furnace[5].mirror = Rgb(1);
  writeText(path("room.gltf"), gltfOf(furnace).dump());
  writeText(path("s.csv"), "0.5,1,0.5,0,0,1\n0.3,0.5,0.2,0,1,0\n");
  solve("--patches 300 --rays 1024 --sensors " + path("s.csv"));
  const auto lines = readCsv(path("s.out.csv"));
  for (size_t k = 1; k < lines.size(); ++k) EXPECT_NEAR(std::stod(lines[k].at(6)), 2, 0.01);
}

// A lamp apart reaches a sensor straight by shadow rays, and over a mirror by rays that meet it: once each.
TEST_F(Mirrors, ShowSensorsALampOnce) {
  auto room = closedBox({2, 3, 2.5}, Rgb(0));
  room[0].mirror = Rgb(0.8);
  constexpr double kLow = 1.3, kSide = 0.4, kHeight = 2.2, kEmission = 50;
  room.push_back(
      {"lamp",
       {{{0.3, kLow, kHeight}, {0.3, kLow + kSide, kHeight}, {0.3 + kSide, kLow + kSide, kHeight}, {0.3 + kSide, kLow, kHeight}}},
       Rgb(0),
       Rgb(kEmission)});
  writeText(path("room.gltf"), gltfOf(room).dump());
  writeText(path("s.csv"), "0.4,1.4,0,0,0,1\n");
  solve("--patches 300 --rays 1024 --sensors " + path("s.csv"));
  double exact = 0;
  constexpr int kPoints = 100;
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      for (const double side : {1.0, -1.0}) {
        const Vec3 d =
            Vec3(side * (0.3 + kSide * (i + 0.5) / kPoints), kLow + kSide * (j + 0.5) / kPoints, kHeight) - Vec3(0.4, 1.4, 0);
        exact += (side > 0 ? 1 : 0.8) * kEmission * kSide * kSide / (kPoints * kPoints) * d.z * d.z /
                 (kPi * std::pow(glm::dot(d, d), 2));
      }
    }
  }
  const auto reading = readCsv(path("s.out.csv")).at(1);
  EXPECT_NEAR(std::stod(reading.at(6)), exact, 0.03 * exact);
  EXPECT_NEAR(std::stod(reading.at(6)), exact, 4 * std::stod(reading.at(9)));
}

// A candle of 10 candela in a room of black walls: a sensor on its floor reads the light and its image, the patches get all that
// walls and mirror do, and energy is kept. Through glass it is followed, which patches have and sensors have not.
TEST_F(Mirrors, ShowPunctualLights) {
  auto room = closedBox({2, 3, 2.5}, Rgb(0));
  room[0].mirror = Rgb(0.8);
  writeWithCandle(room);
  writeText(path("s.csv"), "1.2,1,0,0,0,1\n");
  const auto at = [](double side) {
    const Vec3 d = Vec3(side * 0.5, 1.5, 1.5) - Vec3(1.2, 1, 0);
    return 10 * d.z / std::pow(glm::length(d), 3);
  };
  solve("--patches 400 --rays 1024 --sensors " + path("s.csv"));
  EXPECT_NEAR(std::stod(readCsv(path("s.out.csv")).at(1).at(6)), at(1) + 0.8 * at(-1), 1e-3);
  EXPECT_NEAR(report()["energy"]["from_punctual_lights"][0].get<double>(), 40 * kPi, 0.05) << "all that the candle sends, once";
  EXPECT_LT(report()["energy"]["relative_error"], 1e-4);

  // The mirror behind a pane that takes no light away and does not bend it: images end, and light is followed.
  const double images = solve("--patches 400 --rays 1024").mean;
  room.push_back({"pane",
                  {{{1.9, 2.9, 2.3}, {1.95, 2.9, 2.3}, {1.95, 2.95, 2.3}, {1.9, 2.95, 2.3}}},
                  Rgb(0),
                  Rgb(0),
                  true,
                  Rgb(0),
                  Rgb(1),
                  1});
  writeWithCandle(room);
  EXPECT_NEAR(solve("--patches 400 --rays 1024").mean, images, 0.003 * images);
  EXPECT_NEAR(report()["energy"]["from_punctual_lights"][0].get<double>(), 40 * kPi, 0.5);
  EXPECT_LT(report()["energy"]["relative_error"], 0.002);
  const Outcome o =
      farol("solve " + path("room.gltf") + " --patches 100 --sensors " + path("s.csv") + " --patches-csv " + path("p.csv"));
  EXPECT_EQ(o.exitCode, 0) << o.err;
  EXPECT_THAT(o.err, HasSubstr("[sensors-and-punctual-lights]"));
}

// Mirrors that face each other have 80 images of a candle: more than shadow rays, and it is followed; fewer, and they shine.
TEST_F(Mirrors, ShowPunctualLightsManyTimes) {
  auto room = closedBox({2, 3, 2.5}, Rgb(0));
  room[0].mirror = room[1].mirror = Rgb(0.8);
  ASSERT_EQ(room[1].name, "x1");
  writeWithCandle(room);
  const double followed = solve("--patches 400 --rays 256 --shadow-rays 64").mean,
               images = solve("--patches 400 --rays 256 --shadow-rays 256").mean;
  EXPECT_NEAR(followed, images, 0.005 * images);
  EXPECT_NEAR(report()["energy"]["from_punctual_lights"][0].get<double>(), 40 * kPi, 0.005 * 40 * kPi);
}

TEST_F(Mirrors, AreDrawnInEverySuppliedScene) {
  for (const char* scene : {"mirror_room", "light_pipe", "glass_block", "facing_mirrors"}) {
    const Outcome o = farol(fmt::format("render {}/mirrors_and_glass/{}.gltf --patches 300 --rays 256 --size 64x48 -o {}",
                                        FAROL_SCENES, scene, path("picture.exr")));
    EXPECT_EQ(o.exitCode, 0) << scene << ": " << o.err;
  }
}

}  // namespace
}  // namespace farol::test
