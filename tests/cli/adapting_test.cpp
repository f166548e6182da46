// --adapt: patches of different sizes against patches of one size, on the same fine solution.
#include "cli/patch_size_error.h"
#include "program.h"
#include "test_scene.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <map>

namespace farol::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

// An L-shaped room lit in one arm, and its solution on a fine grid that all trees divide.
class LRoom {
 public:
  static constexpr uint32_t kFine = 4;

  LRoom() : log_(true), scene_(loadScene(FAROL_SCENES "/l_room/l_room.gltf", log_)), facets_(buildFacets(scene_, log_)) {
    options_.scene = scene_.path;
    options_.adapt = 0.015;
    setting_.spec.rays = 1024;
    setting_.shadowRays = 256;
    adapting_ = adaptTo(options_, scene_, facets_, setting_.spec);
  }

  PatchSet fine() const { return buildPatches(scene_, facets_, {0, adapting_.size.size, kFine}); }
  const FacetSet& facets() const { return facets_; }
  const Adapting& adapting() const { return adapting_; }
  const AdaptedPatches& adapted() const { return adapting_.adapted; }
  SizedScene ofTree() const { return {options_, scene_, facets_, adapting_.size, adapting_.adapted.tree}; }
  SizedScene ofLevel(uint32_t level) const { return {options_, scene_, facets_, {0, adapting_.size.size, level}}; }

  Trial trialOf(SizedScene& s) const { return s.solve(setting_); }
  std::vector<Rgb> solved(SizedScene& s) const { return trialOf(s).lighting.solution.irradiance; }

  // Relative error of H of patches at `levels` halvings against means of the finest ones over them.
  double errorOf(const PatchSet& patches, uint32_t levels, const std::vector<Rgb>& h, const PatchSet& fineSet,
                 const std::vector<Rgb>& fineH) const {
    std::vector<Rgb> sum(patches.size(), Rgb(0));
    std::vector<double> area(patches.size(), 0.0);
    Rgb total(0);
    for (uint32_t c = 0; c < fineSet.cells.size(); ++c) {
      const Cell& cell = fineSet.cells[c];
      const CellGrid& grid = patches.grids[cell.facet];
      // Of the finer of the two grids.
      const uint32_t coarse =
          coarserCell(fineSet.grids[cell.facet], facets_.facets[cell.facet].parallelogram, cell, kFine - levels);
      const uint32_t p = patches.cellMap[(cell.back ? grid.backCell : grid.frontCell) + coarse];
      const double a = fineSet.patches[fineSet.cellMap[c]].area;
      sum[p] += a * fineH[fineSet.cellMap[c]];
      area[p] += a;
      total += a * fineH[fineSet.cellMap[c]];
    }
    Rgb squares(0);
    double all = 0;
    for (size_t p = 0; p < patches.size(); ++p) {
      const Rgb d = h[p] - sum[p] / area[p];
      squares += area[p] * d * d;
      all += area[p];
    }
    return maxChannel(glm::sqrt(squares / all) / (total / all));
  }

 private:
  Log log_;
  Scene scene_;
  FacetSet facets_;
  Options options_;
  Setting setting_;
  Adapting adapting_;
};

TEST(Adapting, NeedsFewerPatchesForTheSameError) {
  const LRoom room;
  ASSERT_LE(room.adapted().tree.levels(), LRoom::kFine);
  SizedScene fine = room.ofLevel(LRoom::kFine), tree = room.ofTree(), uniform = room.ofLevel(2);
  const std::vector<Rgb> h = room.solved(fine);
  const Trial ofTree = room.trialOf(tree);
  const double adapted =
      room.errorOf(tree.patches(), room.adapted().tree.levels(), ofTree.lighting.solution.irradiance, fine.patches(), h);
  const double ofOneSize = room.errorOf(uniform.patches(), 2, room.solved(uniform), fine.patches(), h);
  fmt::print("{} adapted patches: {:.2f} % of H; {} of one size: {:.2f} %\n", tree.patches().size(), 100 * adapted,
             uniform.patches().size(), 100 * ofOneSize);
  EXPECT_EQ(tree.patches().size(), room.adapted().patches);
  EXPECT_LT(tree.patches().size(), 1.3 * static_cast<double>(uniform.patches().size()));
  EXPECT_LT(adapted, 0.7 * ofOneSize);
  EXPECT_LT(adapted, 0.015);
  // The finished run tells it, too, all but what rays scatter: by joining, whose mean with the trial's forecast is told.
  const double told = adaptedPatchErrorOf(ofTree.f, tree.patches(), room.facets(), ofTree.lighting, room.adapting());
  fmt::print("told {:.2f} %\n", 100 * told);
  const double byJoining = told * told / room.adapted().error;
  EXPECT_GT(byJoining, 0.8 * adapted);
  EXPECT_LT(byJoining, 1.4 * adapted);
  EXPECT_GT(told, 0.9 * adapted);
  EXPECT_LT(told, 1.5 * adapted);
}

// What a tolerance builds on when it chooses numbers of rays: between powers of two little is gained.
TEST(Adapting, PowersOfTwoAreWorthMore) {
  const LRoom room;
  SizedScene grid = room.ofLevel(3);
  const auto solvedBy = [&](uint32_t rays) {
    Setting setting;
    setting.spec.rays = rays;
    setting.shadowRays = 256;
    return grid.solve(setting).lighting.solution.irradiance;
  };
  const std::vector<Rgb> truth = solvedBy(65536);
  const auto errorOf = [&](uint32_t rays) {
    const std::vector<Rgb> h = solvedBy(rays);
    Rgb squares(0), total(0);
    double area = 0;
    for (size_t i = 0; i < h.size(); ++i) {
      const double a = grid.patches().patches[i].area;
      squares += a * (h[i] - truth[i]) * (h[i] - truth[i]);
      total += a * truth[i];
      area += a;
    }
    return maxChannel(glm::sqrt(squares * area) / total);
  };
  const double half = errorOf(1024), more = errorOf(1536), nearly = errorOf(2000), whole = errorOf(2048);
  fmt::print("{} patches, error of H by 1,024, 1,536, 2,000, 2,048 rays: {:.3f} {:.3f} {:.3f} {:.3f} %\n", grid.patches().size(),
             100 * half, 100 * more, 100 * nearly, 100 * whole);
  EXPECT_LT(whole, 0.9 * nearly);
  EXPECT_LT(whole, half * std::pow(2, -0.6));
  EXPECT_LT(more, half);
}

// Areas times H of a run's patches, by surface.
std::map<std::string, double> fluxes(const std::string& csv) {
  std::map<std::string, double> flux;
  const auto lines = readCsv(csv);
  for (size_t k = 1; k < lines.size(); ++k) flux[lines[k].at(1)] += std::stod(lines[k].at(21)) * std::stod(lines[k].at(19));
  return flux;
}

// A ball of 5,000 triangles: a fifth of the patches give what a patch per triangle gives.
TEST(Clusters, LightARoomAsAPatchPerTriangle) {
  const TemporaryFolder folder;
  writeText(folder.path("ball.gltf"), gltfOf(ballRoom(5000)).dump());
  const auto run = [&](const std::string& command, const std::string& options) {
    const Outcome o = farol(command + " " + folder.path("ball.gltf") + " " + options + " --report " + folder.path("r.json"));
    EXPECT_EQ(o.exitCode, 0) << o.err;
    return json::parse(readText(folder.path("r.json")))["counts"]["patches"].get<size_t>();
  };
  const std::string settings = " --method rays --rays 1024 --shadow-rays 64";
  const size_t single = run("solve", "--patches 1000 --patches-csv " + folder.path("single.csv") + settings);
  const size_t gathered = run("solve", "--patches 1000 --cluster 20 --patches-csv " + folder.path("gathered.csv") + settings);
  EXPECT_LT(gathered, single / 4);
  const auto expected = fluxes(folder.path("single.csv")), found = fluxes(folder.path("gathered.csv"));
  for (const auto& [surface, flux] : expected) {
    if (surface == "lamp") continue;
    EXPECT_NEAR(found.at(surface), flux, 0.01 * flux) << surface;
  }
  // A kept F remembers them.
  run("factors", "--patches 1000 --cluster 20 -o " + folder.path("F.npz") + " --method rays --rays 1024");
  EXPECT_EQ(run("solve", "--factors " + folder.path("F.npz") + " --patches-csv " + folder.path("kept.csv")), gathered);
  EXPECT_EQ(readText(folder.path("kept.csv")), readText(folder.path("gathered.csv")));
}

// A tolerance finds that for itself: on a tenth as many patches as triangles H is as good as asked for.
TEST(Clusters, AreChosenByATolerance) {
  const TemporaryFolder folder;
  const std::string path = folder.path("ball.gltf");
  writeText(path, gltfOf(ballRoom(8000)).dump());
  const Outcome o =
      farol("solve " + path + " --tolerance 0.03 --patches-csv " + folder.path("p.csv") + " --report " + folder.path("r.json"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  EXPECT_THAT(o.out, HasSubstr("--cluster 15"));
  const json r = json::parse(readText(folder.path("r.json")));
  const std::string command = r["equivalent_command"];
  EXPECT_THAT(command, HasSubstr("--cluster 15"));
  Log log(true);
  const Scene scene = loadScene(path, log);
  const FacetSet facets = buildFacets(scene, log);
  const size_t at = command.find("--patch-size ") + 13;
  const PatchSet patches = buildPatches(scene, facets, {0, std::stod(command.substr(at)), 0, 15});
  ASSERT_EQ(patches.size(), r["counts"]["patches"].get<size_t>());
  EXPECT_LT(patches.size(), facets.facets.size() / 4);
  // Four patches on every facet of their own, and their means over the clusters.
  Options options;
  options.scene = path;
  PatchOptions size{0, std::stod(command.substr(at))};
  size.levels = 1;
  SizedScene fine(options, scene, facets, size);
  Setting setting;
  setting.spec.rays = 512;
  const Trial t = fine.solve(setting);
  const std::vector<uint32_t> in = joinedTo(patches, fine.patches(), facets);
  std::vector<double> area(patches.size()), flux(patches.size());
  for (uint32_t p = 0; p < in.size(); ++p) {
    const double a = fine.patches().patches[p].area * t.f.shares(p).exposed;
    area[in[p]] += a;
    flux[in[p]] += a * t.lighting.solution.irradiance[p].r;
  }
  const auto lines = readCsv(folder.path("p.csv"));
  double squares = 0, sum = 0, whole = 0;
  for (size_t p = 0; p < patches.size(); ++p) {
    if (area[p] <= 0) continue;
    squares += area[p] * std::pow(std::stod(lines.at(p + 1).at(18)) - flux[p] / area[p], 2);
    sum += flux[p];
    whole += area[p];
  }
  const double error = std::sqrt(squares / whole) / (sum / whole);
  fmt::print("{} patches of {} facets: {:.2f} % from {} patches\n", patches.size(), facets.facets.size(), 100 * error, in.size());
  EXPECT_LE(error, 0.03);
  // Its command repeats the bytes. What is given is kept, and hemicubes, which take a patch for flat, get none.
  const std::string csv = readText(folder.path("p.csv"));
  ASSERT_EQ(farol(command.substr(6)).exitCode, 0);
  EXPECT_EQ(readText(folder.path("p.csv")), csv);
  EXPECT_THAT(farol("info " + path + " --tolerance 0.05 --cluster 30").out, HasSubstr("--cluster 30"));
  EXPECT_THAT(farol("info " + path + " --tolerance 0.1 --cluster 0").out, Not(HasSubstr("--cluster")));
  writeText(path, gltfOf(ballRoom(1800)).dump());
  EXPECT_THAT(farol("info " + path + " --tolerance 0.1 --method rays").out, HasSubstr("--cluster"));
  EXPECT_THAT(farol("info " + path + " --tolerance 0.1 --method raster --resolution 16").out, Not(HasSubstr("--cluster")));
}

// Fewer rays make rows noisy, but hardly patches smaller: a tenth more where the noise of rows is left in.
TEST(Adapting, DoesNotTakeNoiseForShadows) {
  const LRoom room;
  SizedScene grid = room.ofLevel(3);
  std::array<size_t, 2> patches{};
  for (const size_t k : {size_t{0}, size_t{1}}) {
    Setting setting;
    setting.spec.rays = k == 0 ? 64 : 4096;
    setting.shadowRays = 1024;
    const Trial t = grid.solve(setting);
    patches[k] =
        adaptPatches(room.facets(), grid.patches(), 3, t.f, t.lighting.direct, t.lighting.solution, setting.spec.rays, 1.3, 0.02)
            .patches;
  }
  fmt::print("{} patches by 64 rays, {} by 4,096\n", patches[0], patches[1]);
  EXPECT_NEAR(static_cast<double>(patches[0]), static_cast<double>(patches[1]), 0.06 * static_cast<double>(patches[1]));
}

// Black walls reflect nothing, so that no patch is too large for F; what a picture shows of a lamp's light still asks for small
// ones.
TEST(Adapting, SeesWhatPatchesHide) {
  std::vector<TestSurface> surfaces = closedBox({4, 4, 3}, Rgb(0));
  surfaces.push_back({"lamp", {{{1.8, 1.8, 2.9}, {1.8, 2.2, 2.9}, {2.2, 2.2, 2.9}, {2.2, 1.8, 2.9}}}, Rgb(0), Rgb(10)});
  const Scene scene = loadSurfaces(surfaces);
  Log log(true);
  const FacetSet facets = buildFacets(scene, log);
  Options options;
  options.scene = scene.path;
  options.adapt = 0.02;
  const Adapting a = adaptTo(options, scene, facets, {});
  EXPECT_GT(a.adapted.patches, 3 * facets.facets.size());
}

class AdaptCommand : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_.path(name); }
  json report() const { return json::parse(readText(path("r.json"))); }
  TemporaryFolder folder_;
};

TEST_F(AdaptCommand, EquivalentCommandGivesTheSameBytes) {
  const std::string scene = FAROL_SCENES "/cornell_box/cornell_box.gltf";
  const Outcome o = farol("solve " + scene + " --adapt 0.03 --patches-csv " + path("a.csv") + " --report " + path("r.json"));
  ASSERT_EQ(o.exitCode, 0) << o.err;
  EXPECT_THAT(o.out, HasSubstr("sizes, from"));
  const json r = report();
  EXPECT_GT(r["adapted"]["levels"].get<int>(), 1);
  EXPECT_LT(r["counts"]["patches"].get<int>(), 400);
  EXPECT_NEAR(r["adapted"]["predicted"].get<double>(), 0.03, 0.003);
  const std::string command = r["equivalent_command"];
  ASSERT_THAT(command, HasSubstr("--adapt 0.03"));
  const std::string before = readText(path("a.csv"));
  std::filesystem::remove(path("a.csv"));
  ASSERT_EQ(farol(command.substr(command.find(' '))).exitCode, 0);
  EXPECT_EQ(readText(path("a.csv")), before);
}

// The trial is made by rays, whatever makes F: a plan that changes hemicubes must find the same patches.
TEST_F(AdaptCommand, PatchesDoNotDependOnTheMethod) {
  const auto patches = [&](const std::string& method) {
    EXPECT_EQ(
        farol("solve " FAROL_SCENES "/cornell_box/cornell_box.gltf --adapt 0.04 --report " + path("r.json") + method).exitCode, 0);
    return std::pair(report()["counts"]["patches"].get<int>(), report()["adapted"]["predicted"].get<double>());
  };
  EXPECT_EQ(patches(" --method raster --resolution 16"), patches(" --method rays --rays 64"));
}

TEST_F(AdaptCommand, IsRefusedWherePatchesAreChosenOtherwise) {
  const std::string solve = "solve " FAROL_SCENES "/cornell_box/cornell_box.gltf --adapt 0.02 ";
  for (const char* other : {"--patches 100", "--tolerance 0.01", "--illumination local", "--factors F.npz", "--cluster 10"})
    EXPECT_EQ(farol(solve + other).exitCode, 2) << other;
}

}  // namespace
}  // namespace farol::test
