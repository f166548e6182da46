// Prints the README's table of accuracy: raster form factors against closed forms, for a few settings each.
#include "raster_run.h"

#include "base/machine.h"

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
    for (const auto& v : s["vertices"]) surface.polygons[0].emplace_back(v[0].get<double>(), v[1].get<double>(), v[2].get<double>());
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
  for (const std::string id : {"A1a", "A1d", "A3a", "A5b", "A6c", "A12b", "A13b", "A15a", "A15b"}) {
    const nlohmann::json& c = *std::find_if(cases.begin(), cases.end(), [&](const auto& x) { return x["id"] == id; });
    const auto& e = c["expected"][0];
    const double exact = e["value"];
    fmt::print("| {} | {:.6f} |", c["name"].get<std::string>(), exact);
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
