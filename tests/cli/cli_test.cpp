// The real program on small scenes: exit codes, messages, files, report.
#include "program.h"
#include "test_scene.h"

#include <cmath>
#include <gmock/gmock.h>

namespace farol::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

const std::string kCornell = FAROL_SCENES "/cornell_box/cornell_box.gltf";
const std::string kFurnace = FAROL_SCENES "/white_furnace/white_furnace.gltf";

TEST(Program, ShowsHelpAndVersion) {
  EXPECT_THAT(farol("--version").out, HasSubstr("farol "));
  const Outcome help = farol("--help");
  EXPECT_EQ(help.exitCode, 0);
  for (const char* command : {"render", "solve", "factors", "info", "devices", "Exit codes"})
    EXPECT_THAT(help.out, HasSubstr(command));
  const Outcome render = farol("render --help");
  EXPECT_EQ(render.exitCode, 0);
  for (const char* text : {"--patches", "4000", "--resolution", "64", "--positions", "--exposure", "1280x720"})
    EXPECT_THAT(render.out, HasSubstr(text));
}

TEST(Program, ListsDevices) {
  const Outcome o = farol("devices");
  EXPECT_EQ(o.exitCode, 0);
  EXPECT_THAT(o.out, HasSubstr("0: "));
  EXPECT_THAT(o.out, HasSubstr("CPU: "));
}

TEST(Render, DrawsAPictureWithAReport) {
  const TemporaryFolder folder;
  const Outcome o = farol("render " + kCornell + " -o " + folder.path("p.png") + " --size 64x48 --patches 400 --report " +
                          folder.path("r.json") + " --patches-csv " + folder.path("p.csv"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  EXPECT_THAT(o.out, HasSubstr("converged"));
  const std::string png = readText(folder.path("p.png"));
  EXPECT_EQ(png.substr(1, 3), "PNG");
  EXPECT_EQ(static_cast<unsigned char>(png[19]), 64);
  EXPECT_EQ(static_cast<unsigned char>(png[23]), 48);
  EXPECT_EQ(folder.files(), (std::vector<std::string>{"p.csv", "p.png", "r.json"}));

  const json r = json::parse(readText(folder.path("r.json")));
  EXPECT_TRUE(r["solve"]["converged"].get<bool>());
  EXPECT_LE(r["row_sums"]["max"].get<double>(), 1 + 1e-6);
  EXPECT_EQ(r["counts"]["surfaces"], 8);
  EXPECT_EQ(r["counts"]["patches"].get<size_t>() + 1, readCsv(folder.path("p.csv")).size());
  double sum = 0;
  for (const json& stage : r["stages"]) sum += stage["seconds"].get<double>();
  EXPECT_NEAR(sum, r["total_seconds"].get<double>(), 1e-9);
  const auto peak = r["peak_bytes"].get<double>(), counted = static_cast<double>(o.peakBytes);
  EXPECT_NEAR(peak, counted, 0.05 * counted);  // as the operating system counts it
}

TEST(Render, WritesLinearRadianceAsExr) {
  const TemporaryFolder folder;
  const Outcome o = farol("render " + kFurnace + " -o " + folder.path("p.exr") + " --size 32x32 --patches 150");
  ASSERT_EQ(o.exitCode, 0) << o.err;
  EXPECT_EQ(readText(folder.path("p.exr")).substr(0, 4), "\x76\x2f\x31\x01");
}

// The report's equivalent command repeats the run byte for byte, on any number of threads.
TEST(Render, RepeatsBytesFromTheEquivalentCommand) {
  const TemporaryFolder folder;
  ASSERT_EQ(
      farol("render " + kCornell + " -o " + folder.path("a.png") + " --size 80x80 --patches 300 --report " + folder.path("r.json"))
          .exitCode,
      0);
  const std::string first = readText(folder.path("a.png"));
  std::string command = json::parse(readText(folder.path("r.json")))["equivalent_command"];
  ASSERT_TRUE(command.starts_with("farol "));
  const Outcome o = farol(command.substr(6) + " --threads 1");
  ASSERT_EQ(o.exitCode, 0) << o.err;
  EXPECT_EQ(readText(folder.path("a.png")), first);
}

// The local picture of the thesis's Figure 2.1: no interreflection, so red light reaches no white wall.
TEST(Render, DrawsLocalIllumination) {
  const TemporaryFolder folder;
  const Outcome o = farol("render " + kCornell + " -o " + folder.path("p.png") +
                          " --size 40x40 --patches 300 --illumination local --patches-csv " + folder.path("p.csv"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  EXPECT_THAT(o.out, HasSubstr("local illumination"));
  const auto rows = readCsv(folder.path("p.csv"));
  for (size_t i = 1; i < rows.size(); ++i) {
    const double r = std::stod(rows[i][18]), b = std::stod(rows[i][20]);
    EXPECT_NEAR(b, r * 4.0 / 17, 1e-9 * (1 + r));  // the lamp's own colour everywhere
  }
}

TEST(Solve, KnowsTheWhiteFurnace) {
  const TemporaryFolder folder;
  const Outcome o = farol("solve " + kFurnace + " -o " + folder.path("lit.glb") + " --patches 300 --residual 1e-9 --patches-csv " +
                          folder.path("p.csv"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  const double expected[3] = {1 / (1 - 0.5), 1 / (1 - 0.8), 1 / (1 - 0.9)};
  const auto rows = readCsv(folder.path("p.csv"));
  for (size_t i = 1; i < rows.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(std::stod(rows[i][15 + c]), expected[c], 1e-5 * expected[c]);
  }
  EXPECT_EQ(readText(folder.path("lit.glb")).substr(0, 4), "glTF");
}

TEST(Solve, AgreesBetweenSolvers) {
  const TemporaryFolder folder;
  for (const std::string solver : {"jacobi", "gauss-seidel", "conjugate-residuals"}) {
    ASSERT_EQ(
        farol("solve " + kCornell + " --patches 300 --residual 1e-8 --solver " + solver + " --patches-csv " + folder.path(solver))
            .exitCode,
        0);
  }
  const auto a = readCsv(folder.path("jacobi"));
  for (const char* other : {"gauss-seidel", "conjugate-residuals"}) {
    const auto b = readCsv(folder.path(other));
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 1; i < a.size(); ++i) EXPECT_NEAR(std::stod(a[i][15]), std::stod(b[i][15]), 1e-6);
  }
}

// One floor under a uniform sky that fills its hemisphere: H = sky.
TEST(Solve, LightsAnOpenFloorFromTheSky) {
  const TemporaryFolder folder;
  writeText(folder.path("floor.gltf"), gltfOf({{"floor", {{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}}, Rgb(0.25)}}).dump());
  const Outcome o = farol("solve " + folder.path("floor.gltf") + " --patches 16 --sky 3,2,1 --patches-csv " + folder.path("p.csv"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  const auto rows = readCsv(folder.path("p.csv"));
  EXPECT_NEAR(std::stod(rows[1][18]), 3, 1e-12);
  EXPECT_NEAR(std::stod(rows[1][15]), 0.75, 1e-12);
}

TEST(Factors, WritesATableBySurface) {
  const TemporaryFolder folder;
  writeText(folder.path("box.gltf"), gltfOf(closedBox({1, 2, 3})).dump());
  const Outcome o = farol("factors " + folder.path("box.gltf") + " -o " + folder.path("f.csv") + " --patches 300 --positions 4");
  ASSERT_EQ(o.exitCode, 0) << o.err;
  const auto rows = readCsv(folder.path("f.csv"));
  ASSERT_EQ(rows.size(), 7u);
  EXPECT_EQ(rows[0], (std::vector<std::string>{"surface", "area", "x0", "x1", "y0", "y1", "z0", "z1", "(open)", "(cut)"}));
  for (size_t i = 1; i < 7; ++i) {
    double sum = 0;
    for (size_t j = 2; j < rows[i].size(); ++j) sum += std::stod(rows[i][j]);
    EXPECT_NEAR(sum, 1, 1e-6);
  }
  EXPECT_NEAR(std::stod(rows[1][3]), 0.4755764365329529, 0.003 * 0.4756);  // x0 -> x1
}

TEST(Factors, WritesMatricesByPatch) {
  const TemporaryFolder folder;
  ASSERT_EQ(farol("factors " + kFurnace + " -o " + folder.path("f.npy") + " --patches 54").exitCode, 0);
  ASSERT_EQ(farol("factors " + kFurnace + " -o " + folder.path("f.mtx") + " --patches 54").exitCode, 0);
  EXPECT_THAT(readText(folder.path("f.npy")), HasSubstr("'shape': (54, 54)"));
  EXPECT_THAT(readText(folder.path("f.mtx")), HasSubstr("%%MatrixMarket matrix coordinate real general"));
  EXPECT_EQ(farol("factors " + kFurnace + " -o " + folder.path("g.npy") + " --by surface").exitCode, 2);
}

// Points, and a grid over a plane, from one file.
TEST(Sensors, ReadPointsAndGrids) {
  const TemporaryFolder folder;
  writeText(folder.path("s.csv"), "x,y,z,nx,ny,nz\n0.5,0.5,0.5,0,0,1\ngrid,0.1,0.1,0.7,0.8,0,0,0,0.8,0,3,2\n");
  const Outcome o = farol("solve " + kFurnace + " --patches 150 --residual 1e-8 --sensors " + folder.path("s.csv"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  const auto rows = readCsv(folder.path("s.out.csv"));
  ASSERT_EQ(rows.size(), 8u);
  EXPECT_EQ(rows[0], (std::vector<std::string>{"x", "y", "z", "nx", "ny", "nz", "H_r", "H_g", "H_b", "err"}));
  for (size_t k = 1; k < rows.size(); ++k) {
    EXPECT_NEAR(std::stod(rows[k][6]), 2, 2e-5);
    EXPECT_NEAR(std::stod(rows[k][8]), 10, 1e-4);
  }
  writeText(folder.path("bad.csv"), "0,0,0,0,0,1\n1,2,3\n");
  const Outcome bad = farol("solve " + kFurnace + " --sensors " + folder.path("bad.csv"));
  EXPECT_EQ(bad.exitCode, 1);
  EXPECT_THAT(bad.err, HasSubstr("bad.csv: line 2: '1,2,3' is neither"));
}

// Raster and rays agree on every supplied scene within what both state, on 95 of 100 rows.
TEST(Compare, FindsRasterAndRaysInAgreementOnEverySuppliedScene) {
  const TemporaryFolder folder;
  for (const std::string scene : {"cornell_box/cornell_box.gltf", "l_room/l_room.gltf", "white_furnace/white_furnace.gltf",
                                  "reading_corner/reading_corner.glb"}) {
    const Outcome o = farol("compare " FAROL_SCENES "/" + scene + " raster:128 rays:4096 --patches 1500 --report " +
                            folder.path("r.json") + " -o " + folder.path("d.png") + " --size 64x48");
    ASSERT_EQ(o.exitCode, 0) << o.err;
    const json r = json::parse(readText(folder.path("r.json")));
    EXPECT_GE(r["comparison"]["within_estimate"].get<double>(), 0.95) << scene;
    EXPECT_THAT(o.out, HasSubstr("worst row"));
    EXPECT_EQ(readText(folder.path("d.png")).substr(1, 3), "PNG");
  }
  EXPECT_EQ(farol("compare " + kCornell + " raster:65 rays:4").exitCode, 2);
  EXPECT_THAT(farol("compare " + kCornell + " hemisphere rays:4").err, HasSubstr("'hemisphere' is not a method"));
}

TEST(Info, ForecastsAndWritesNothing) {
  const TemporaryFolder folder;
  const Outcome o = farol("info " + kCornell);
  EXPECT_EQ(o.exitCode, 0) << o.err;
  for (const char* text : {"8 surfaces", "camera 'camera'", "MB", "rows/s"}) EXPECT_THAT(o.out, HasSubstr(text));
  EXPECT_TRUE(folder.files().empty());
}

nlohmann::json reportOf(const std::string& command) {
  const TemporaryFolder folder;
  EXPECT_EQ(farol(command + " --quiet --report " + folder.path("r.json")).exitCode, 0) << command;
  return nlohmann::json::parse(readText(folder.path("r.json")));
}

// Dense rows, lists of hits, lists of entries; back sides that have rows; mirrors.
TEST(Info, ForecastsTheMemoryOfF) {
  const std::string scenes = FAROL_SCENES "/";
  for (const std::string run :
       {"cornell_box/cornell_box.gltf --patches 1000 --rays 4096", "cornell_box/cornell_box.gltf --patches 4000 --rays 256",
        "cornell_box/cornell_box.gltf --patches 4000 --rays 1024", "reading_corner/reading_corner.glb --patches 12000 --rays 512",
        "mirrors_and_glass/mirror_room.gltf --patches 1000 --rays 512"}) {
    const double forecast = reportOf("info " + scenes + run + " --method rays")["matrix_bytes"],
                 made = reportOf("factors " + scenes + run + " --method rays")["matrix_bytes"];
    EXPECT_NEAR(forecast, made, 0.03 * made) << run;
  }
}

TEST(Info, TellsWhereSolveWouldBeRefused) {
  const TemporaryFolder folder;
  auto box = closedBox({1, 1, 1}, Rgb(1));
  for (TestSurface& wall : box) wall.emission = Rgb(1);
  writeText(folder.path("lossless.gltf"), gltfOf(box).dump());
  ASSERT_EQ(farol("solve " + folder.path("lossless.gltf") + " --patches 100").exitCode, 1);
  const Outcome o = farol("info " + folder.path("lossless.gltf") + " --patches 100");
  EXPECT_EQ(o.exitCode, 0) << o.err;
  EXPECT_THAT(o.out, HasSubstr("solve would be refused"));
}

// Of the whole process: lists of hits, dense rows that end as lists, several sizes of patches, hemicubes.
TEST(Info, ForecastsThePeakOfMemory) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || defined(__clang__)
  GTEST_SKIP() << "sanitizers keep memory of their own";
#endif
  const std::string scenes = FAROL_SCENES "/";
  for (const std::string run :
       {"cornell_box/cornell_box.gltf --patches 40000 --rays 256 --method rays",
        "cornell_box/cornell_box.gltf --patches 4000 --rays 1024 --method rays",
        "reading_corner/reading_corner.glb --patches 30000 --rays 128 --method rays", "l_room/l_room.gltf --tolerance 0.003",
        "l_room/l_room.gltf --patches 6000 --resolution 32 --method raster"}) {
    const double forecast = reportOf("info " + scenes + run)["forecast"]["peak_bytes"],
                 made = reportOf("solve " + scenes + run)["peak_bytes"];
    std::printf("%s: %.1f MB of %.1f\n", run.c_str(), 1e-6 * forecast, 1e-6 * made);
    EXPECT_NEAR(forecast, made, 0.1 * made) << run;
  }
}

TEST(Quiet, LeavesStandardOutputEmpty) {
  const TemporaryFolder folder;
  const Outcome o = farol("render " + kCornell + " -o " + folder.path("p.png") + " --size 16x16 --patches 100 --quiet");
  EXPECT_EQ(o.exitCode, 0);
  EXPECT_EQ(o.out, "");
  EXPECT_EQ(o.err, "");
}

}  // namespace
}  // namespace farol::test
