// Rows per second of raster, rays and hybrid without specular surfaces, with one mirror, with ten, and with glass; and
// what hybrid costs beside rays at the same error of rows.
#include "base/machine.h"
#include "formfactor/images.h"
#include "raster_run.h"

#include <cmath>
#include <fmt/format.h>
#include <optional>

namespace {

using namespace farol;
using namespace farol::test;

std::vector<TestSurface> room(int mirrors, bool glass) {
  auto surfaces = closedBox({4, 5, 2.5}, Rgb(0.5));
  for (int k = 0; k < mirrors; ++k) {  // on the wall y = 0, facing the room
    const double x = 0.1 + 0.38 * k, width = mirrors == 1 ? 3 : 0.3;
    surfaces.push_back(
        {fmt::format("mirror{}", k), {{{x, 0.02, 0.5}, {x, 0.02, 2}, {x + width, 0.02, 2}, {x + width, 0.02, 0.5}}}, Rgb(0)});
    surfaces.back().mirror = Rgb(0.9);
  }
  if (glass) {
    for (TestSurface& s : closedBox({0.8, 0.8, 0.8})) {
      for (Vec3& p : s.polygons[0]) p += Vec3(1.6, 2, 0.4);
      std::reverse(s.polygons[0].begin(), s.polygons[0].end());
      surfaces.push_back({"glass " + s.name, s.polygons, Rgb(0)});
      surfaces.back().transmission = Rgb(1);
      surfaces.back().solid = true;
    }
  }
  return surfaces;
}

struct Measured {
  double rowsPerSecond = 0, error = 0;  // mean L1 error of the probe rows
};

Measured measure(RowMaker& maker, const std::vector<uint32_t>& probes, const FormFactorMatrix& reference, size_t patches) {
  FormFactorMatrix warmUp(patches), f(patches);
  maker.makeRows(std::span(probes).first(1), warmUp, [](size_t) {});
  const Stopwatch watch;
  maker.makeRows(probes, f, [](size_t) {});
  Measured m{static_cast<double>(probes.size()) / watch.seconds(), 0};
  for (const uint32_t i : probes) {
    const auto a = f[i].expanded(), b = reference[i].expanded();
    for (size_t j = 0; j < patches; ++j)
      m.error += std::abs(static_cast<double>(a[j]) - static_cast<double>(b[j])) / static_cast<double>(probes.size());
  }
  return m;
}

}  // namespace

int main() {
  fmt::print("{} and {}\n| scene | method | rows/s | row error (L1) | time for the error of rays:4096 |\n|---|---|---|---|---|\n",
             device().info().name, Tracer::versionText());
  const std::tuple<const char*, int, bool> scenes[] = {
      {"no mirror", 0, false}, {"one mirror", 1, false}, {"ten mirrors", 10, false}, {"glass block", 0, true}};
  for (const auto& [name, mirrors, glass] : scenes) {
    const Scene scene = loadSurfaces(room(mirrors, glass));
    RayRun run(scene, {2000, 0}, {.rays = 4096});
    const size_t n = run.patches.size();
    const std::vector<uint32_t> probes = chooseProbes(run.patches, 256);
    FormFactorMatrix reference(n);
    RayRowMaker(run.tracer, run.facets, run.patches, {.rays = 1u << 18, .seed = 9}).makeRows(probes, reference, [](size_t) {});
    const Measured rays = measure(*run.maker(), probes, reference, n);
    const auto line = [&, name = name](const char* method, const Measured& m) {
      // Errors of rows fall as samples^-0.57.
      const double atEqual = rays.rowsPerSecond / m.rowsPerSecond * std::pow(m.error / rays.error, 1 / 0.57);
      fmt::print("| {} | {} | {:.0f} | {:.3f} | {:.2f} times that of rays |\n", name, method, m.rowsPerSecond, m.error, atEqual);
    };
    line("rays:4096", rays);
    const RayTree tree(run.tracer, run.facets, run.patches, {});
    RasterOptions options;
    options.positions = 4;
    RasterOptions imaged = options;
    std::optional<ImageTrees> images;
    if (run.patches.anySpecular()) options.tree = &tree;
    if (!glass) {
      if (mirrors > 0) imaged.images = &images.emplace(run.scene, run.facets, run.patches, TreeLimits{}, 256);
      line("raster:64,positions=4",
           measure(*std::make_unique<RasterRowMaker>(device(), run.facets, run.patches, imaged), probes, reference, n));
    }
    line("hybrid:64,positions=4",
         measure(*std::make_unique<RasterRowMaker>(device(), run.facets, run.patches, options), probes, reference, n));
  }
}
