// Model no more than a scene needs: what leaving each thing out saves, on rooms that do not need it. A room in which one patch
// needs it, by next to nothing, is computed with all of it.
#include "base/machine.h"
#include "factor_run.h"
#include "solve/solver.h"

#include <algorithm>
#include <fmt/format.h>

namespace {

using namespace farol;
using namespace farol::test;

// White walls, a grey floor, a lamp; on a wall a mirror of 4 cm where one is wanted.
Scene room(bool mirror) {
  auto surfaces = closedBox({4, 5, 2.5}, Rgb(0.7));
  surfaces[4].reflectance = Rgb(0.3);
  surfaces.push_back({"lamp", {{{1.7, 2, 2.4}, {1.7, 3, 2.4}, {2.3, 3, 2.4}, {2.3, 2, 2.4}}}, Rgb(0), Rgb(10)});
  if (mirror) {
    surfaces.push_back({"mirror", {{{2, 0.02, 1}, {2, 0.02, 1.04}, {2.04, 0.02, 1.04}, {2.04, 0.02, 1}}}, Rgb(0)});
    surfaces.back().mirror = Rgb(0.9);
  }
  return loadSurfaces(surfaces);
}

double medianOf(const std::function<void()>& work) {
  constexpr size_t kRuns = 7;
  std::vector<double> seconds;
  for (size_t run = 0; run < kRuns; ++run) {
    const Stopwatch watch;
    work();
    seconds.push_back(watch.seconds());
  }
  std::nth_element(seconds.begin(), seconds.begin() + kRuns / 2, seconds.end());
  return seconds[kRuns / 2];
}

void print(const char* what, size_t patches, uint32_t rays, double without, double with) {
  fmt::print("| {} | {} | {} | {:.2f} | {:.2f} | {:.2f} |\n", what, patches, rays, 1e3 * without, 1e3 * with, with / without);
  std::fflush(stdout);
}

}  // namespace

int main() {
  fmt::print("{}, {}\n| left out | patches | rays | without, ms | with, ms | ratio |\n|---|---|---|---|---|---|\n", processorName(),
             Tracer::versionText());
  for (const auto& [patches, rays] : {std::pair<size_t, uint32_t>{4000, 1024}, {4000, 16384}, {12000, 1024}}) {
    RayRun run(room(false), {patches, 0}, {.rays = rays});
    run.makeAll();
    const auto solve = [&] { return solveRadiosity(run.f, run.patches, {}, run.scene, {}, Log(true)); };
    const double grey = medianOf(solve);
    Patch& one = run.patches.patches[0];
    one.reflectance.g -= 1e-9;
    const double three = medianOf(solve);
    print("two of three channels, solve", run.patches.size(), rays, grey, three);
    for (Patch& p : run.patches.patches) {  // the upper half
      if (p.centre.z > 1.2) p.reflectance = Rgb(0);
    }
    const double black = medianOf(solve);
    for (Patch& p : run.patches.patches) p.reflectance = glm::max(p.reflectance, Rgb(1e-9, 1e-9, 1e-9));
    print("black surfaces, sweeps", run.patches.size(), rays, black, medianOf(solve));
  }
  for (const uint32_t rays : {256u, 4096u}) {
    const auto rows = [&](bool mirror) {
      RayRun run(room(mirror), {2000, 0}, {.rays = rays});
      return medianOf([&] { run.makeAll(); }) / static_cast<double>(run.patches.size()) * 2000;
    };
    const double without = rows(false);
    print("mirrors and glass, rows", 2000, rays, without, rows(true));
  }
}
