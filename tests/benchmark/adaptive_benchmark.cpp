// Patches as small as their light asks for against patches of one size: the error of H that each costs, on the patches
// themselves and on a grid of 8 x 8 per facet (as a picture shows it), against gathering paths.
// Then a detailed model, a patch per triangle against patches of many.
// farol_adaptive [seconds of reference, SCENE...]
#include "cli/patch_size_error.h"
#include "reference/gathering.h"
#include "solve/node_irradiance.h"
#include "test_scene.h"

#include <fmt/format.h>

using namespace farol;

namespace {

// H as a picture shows it, as means over the patches of a grid.
std::vector<Rgb> shownOn(const PatchSet& grid, const FacetSet& facets, const NodeIrradiance& nodes) {
  std::vector<Rgb> h(grid.size(), Rgb(0));
  constexpr int kPoints = 4;
  for (uint32_t p = 0; p < grid.size(); ++p) {
    const Cell& cell = grid.cells[grid.cellsOf(p)[0]];
    const bool parallelogram = facets.facets[cell.facet].parallelogram;
    if (!nodes.has(cell.facet, cell.back)) continue;
    for (int i = 0; i < kPoints; ++i) {
      for (int j = 0; j < kPoints; ++j) {
        double s = (i + 0.5) / kPoints, t = (j + 0.5) / kPoints;
        if (!parallelogram && s + t > 1) {
          s = 1 - s;
          t = 1 - t;
        }
        const Vec2 uv = cellPoint(grid.grids[cell.facet], parallelogram, cell, s, t);
        h[p] += nodes.at(cell.facet, cell.back, uv.x, uv.y) / static_cast<double>(kPoints * kPoints);
      }
    }
  }
  return h;
}

struct Line {
  std::string what;
  std::unique_ptr<SizedScene> scene;
  std::vector<Rgb> own, shown;
  double predicted = 0;
};

void detailedModel(double seconds) {
  Log log(true);
  const Scene scene = test::loadSurfaces(test::ballRoom(50000));
  const FacetSet facets = buildFacets(scene, log);
  Options options;
  options.command = Command::solve;
  options.scene = "a ball";
  Setting setting;
  setting.spec.rays = 1024;
  PatchOptions gathered{2000, 0};
  gathered.cluster = 15;
  SizedScene single(options, scene, facets, {2000, 0}), clustered(options, scene, facets, gathered);
  const std::array<SizedScene*, 2> scenes{&single, &clustered};
  const std::array<const PatchSet*, 2> sets{&single.patches(), &clustered.patches()};
  const Tracer tracer(facets);
  const LampPlan lamps = chooseLamps(facets, single.patches(), {});
  const PathGatherer gatherer(tracer, facets, single.patches(), scene, lamps, Rgb(0), {});
  const std::vector<GatheredIrradiance> truth = gatherIrradiance(gatherer, tracer, facets, sets, seconds, 77, [](double) {});
  fmt::print(
      "a ball of {} facets in a room\n| patches | MB of F | seconds of rows, light and solve | error of H % | resolved to | shown "
      "on the facets % | resolved to |\n|---|---|---|---|---|---|---|\n",
      facets.facets.size());
  for (const size_t k : {size_t{0}, size_t{1}}) {
    const Trial t = scenes[k]->solve(setting);
    const NodeIrradiance nodes(scene, facets, *sets[k], &t.f, t.lighting.solution.irradiance);
    const HError own = errorOf(t.lighting.solution.irradiance, *sets[k], truth[k]),
                 shown = errorOf(shownOn(single.patches(), facets, nodes), single.patches(), truth[0]);
    fmt::print("| {} | {:.0f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |\n", sets[k]->size(),
               1e-6 * static_cast<double>(t.f.bytes()), t.seconds(), 100 * own.error, 100 * own.noise, 100 * shown.error,
               100 * shown.noise);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = argc > 1 ? std::stod(argv[1]) : 60;
  std::vector<std::string> scenes(argv + std::min(argc, 2), argv + argc);
  if (scenes.empty()) scenes = {FAROL_SCENES "/l_room/l_room.gltf", FAROL_SCENES "/cornell_box/cornell_box.gltf"};
  for (const std::string& path : scenes) {
    Log log(true);
    const Scene scene = loadScene(path, log);
    const FacetSet facets = buildFacets(scene, log);
    Options options;
    options.command = Command::solve;
    options.scene = path;
    Setting setting;
    setting.spec.rays = 4096;
    setting.shadowRays = 1024;
    PatchSet grid = buildPatches(scene, facets, {1, 1e9, 3});  // 8 x 8 cells per facet
    std::vector<Line> lines;
    const auto add = [&](std::string what, std::unique_ptr<SizedScene> made, double predicted) {
      const Trial t = made->solve(setting);
      const NodeIrradiance nodes(scene, facets, made->patches(), &t.f, t.lighting.solution.irradiance);
      lines.push_back({std::move(what), std::move(made), t.lighting.solution.irradiance, shownOn(grid, facets, nodes), predicted});
    };
    for (const size_t count : {100, 200, 400, 800, 1600, 3200, 6400})
      add(fmt::format("--patches {}", count), std::make_unique<SizedScene>(options, scene, facets, PatchOptions{count, 0}), 0);
    constexpr uint32_t kLevel = 3;
    const double roots = static_cast<double>(facets.facets.size());
    PatchOptions size{0, sizeForPatches(facets, static_cast<size_t>(roots))};
    size.levels = kLevel;
    SizedScene coarse(options, scene, facets, size);
    Setting few = setting;
    few.spec.rays = 1024;
    few.shadowRays = 256;
    const Trial trial = coarse.solve(few);
    const double order = patchErrorOf(trial.f, coarse.patches(), facets, trial.lighting).order;
    fmt::print("{}: trial of {} patches, order {:.2f}\n", path, coarse.patches().size(), order);
    for (const double error : {0.04, 0.03, 0.02, 0.015, 0.01}) {
      const AdaptedPatches adapted = adaptPatches(facets, coarse.patches(), kLevel, trial.f, trial.lighting.direct,
                                                  trial.lighting.solution, 1024, order, error);
      add(fmt::format("adapted to {}", error),
          std::make_unique<SizedScene>(options, scene, facets, PatchOptions{0, size.size}, adapted.tree), adapted.error);
    }
    std::vector<const PatchSet*> sets{&grid};
    for (const Line& l : lines) sets.push_back(&l.scene->patches());
    const Tracer tracer(facets);
    const LampPlan lamps = chooseLamps(facets, lines.back().scene->patches(), {});
    const PathGatherer gatherer(tracer, facets, lines.back().scene->patches(), scene, lamps, Rgb(0), {});
    std::swap(sets.front(), sets.back());
    std::vector<GatheredIrradiance> truth = gatherIrradiance(gatherer, tracer, facets, sets, seconds, 77, [](double) {});
    std::swap(truth.front(), truth.back());
    fmt::print(
        "| patches | | error of H % | resolved to | as shown % | resolved to | predicted % |\n|---|---|---|---|---|---|---|\n");
    for (size_t k = 0; k < lines.size(); ++k) {
      const size_t at = k + 1 < lines.size() ? k + 1 : 0;
      const HError own = errorOf(lines[k].own, *sets[at == 0 ? 0 : at], at == 0 ? truth.back() : truth[at]);
      const HError shown = errorOf(lines[k].shown, grid, truth[0]);
      fmt::print("| {} | {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {} |\n", lines[k].scene->patches().size(), lines[k].what,
                 100 * own.error, 100 * own.noise, 100 * shown.error, 100 * shown.noise,
                 lines[k].predicted > 0 ? fmt::format("{:.2f}", 100 * lines[k].predicted) : "");
    }
  }
  detailedModel(seconds);
}
