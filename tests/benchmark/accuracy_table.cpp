// Prints the README's table of accuracy: raster form factors against closed forms, for a few settings each.
#include "base/machine.h"
#include "raster_run.h"

#include <fmt/format.h>

namespace {

using namespace farol;
using namespace farol::test;

struct Setting {
  const char* name;
  Projection projection;
  uint32_t resolution;
  int positions;
};

constexpr Setting kSettings[] = {{"hemicube 64", Projection::hemicube, 64, 1},
                                 {"tetrahedron 64", Projection::tetrahedron, 64, 1},
                                 {"hemicube 64, 4 positions", Projection::hemicube, 64, 4},
                                 {"hemicube 128, 9 positions", Projection::hemicube, 128, 9}};

std::vector<TestSurface> polygonsOf(const nlohmann::json& testCase) {
  std::vector<TestSurface> surfaces;
  for (const auto& s : testCase["surfaces"]) {
    TestSurface surface{s["name"], {{}}};
    for (const auto& v : s["vertices"])
      surface.polygons[0].emplace_back(v[0].get<double>(), v[1].get<double>(), v[2].get<double>());
    surface.twoSided = s.value("two_sided", false);
    surfaces.push_back(surface);
  }
  return surfaces;
}

}  // namespace

int main() {
  const std::vector<nlohmann::json> cases = nlohmann::json::parse(readText(FAROL_TESTS "/analytic/form_factors.json"))["cases"];
  fmt::print("Relative error of the factor between two surfaces of about 200 patches each, on {}:\n\n", device().info().name);
  fmt::print("| case | exact |");
  for (const Setting& s : kSettings) fmt::print(" {} |", s.name);
  fmt::print("\n|---|---|");
  for (size_t k = 0; k < std::size(kSettings); ++k) fmt::print("---|");
  fmt::print("\n");
  std::vector<double> seconds(std::size(kSettings)), rows(std::size(kSettings));
  const std::pair<std::string, const char*> chosen[] = {{"A1a", "parallel squares, distance 1"},
                                                        {"A1d", "parallel squares, distance 0.1"},
                                                        {"A3a", "squares sharing an edge at 90 degrees"},
                                                        {"A5b", "parallel rectangles, far apart"},
                                                        {"A6c", "rectangles sharing an edge at 30 degrees"},
                                                        {"A12b", "closed box 1 x 2 x 3, wall to wall"},
                                                        {"A13b", "corner tetrahedron, triangle to triangle"},
                                                        {"A15a", "squares with a blocker of 0.5 half way"},
                                                        {"A15b", "squares with a blocker of 0.8 half way"}};
  for (const auto& [id, name] : chosen) {
    const nlohmann::json& c =
        *std::find_if(cases.begin(), cases.end(), [&, wanted = id](const auto& x) { return x["id"] == wanted; });
    const auto& e = c["expected"][0];
    const double exact = e["value"];
    fmt::print("| {} | {:.6f} |", name, exact);
    for (size_t k = 0; k < std::size(kSettings); ++k) {
      RasterOptions options;
      options.projection = kSettings[k].projection;
      options.resolution = kSettings[k].resolution;
      options.positions = kSettings[k].positions;
      RasterRun run(loadSurfaces(polygonsOf(c)), {c["surfaces"].size() * 200, 0}, options);
      const Stopwatch watch;
      const double found = run.factor(e["from"], e["to"]);
      seconds[k] += watch.seconds();
      rows[k] += static_cast<double>(run.patchesOf(e["from"]).size());
      fmt::print(" {:+.3f} % |", 100 * (found / exact - 1));
    }
    fmt::print("\n");
  }
  fmt::print("| rows per second | |");
  for (size_t k = 0; k < std::size(kSettings); ++k) fmt::print(" {:.0f} |", rows[k] / seconds[k]);
  fmt::print("\n");
}
