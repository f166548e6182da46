// Seconds and memory from 10,000 to a million patches, whole processes, beside what `farol info` forecasts, and the error of H
// against gathering paths. farol_scale [seconds of reference, SCENE]
#include "judge.h"
#include "whole_process.h"

#include <nlohmann/json.hpp>

using namespace farol;
using namespace farol::benchmark;
using nlohmann::json;
using test::TemporaryFolder;

namespace {

struct Size {
  size_t patches;
  double tolerance;
};
struct Measured {
  double patches = 0, seconds = 0, bytes = 0;
};

double exponent(double from, double to, double patchesFrom, double patchesTo) {
  return std::log(to / from) / std::log(patchesTo / patchesFrom);
}

}  // namespace

int main(int argc, char** argv) {
  const double reference = argc > 1 ? std::stod(argv[1]) : 30;
  const std::string scene = argc > 2 ? argv[2] : FAROL_SCENES "/cornell_box/cornell_box.gltf";
  const TemporaryFolder folder;
  const std::string csv = folder.path("p.csv"), report = folder.path("r.json");
  Judge judge(scene);
  fmt::print(
      "| patches | tolerance | chosen | error of H | seconds | forecast | peak memory [MB] | forecast "
      "|\n|---|---|---|---|---|---|---|---|\n");
  for (const auto& [small, large] :
       {std::pair{Size{10'000, 0.01}, Size{100'000, 0.01}}, std::pair{Size{10'000, 0.02}, Size{1'000'000, 0.02}}}) {
    std::array<Measured, 2> measured;
    for (const size_t k : {size_t{0}, size_t{1}}) {
      const Size& size = k == 0 ? small : large;
      const std::string options = fmt::format("{} --patches {} --tolerance {} --quiet --report {} 2> /dev/null", scene,
                                              size.patches, size.tolerance, report);
      medianSeconds(fmt::format("{} info {}", FAROL_PROGRAM, options), 1);
      const json forecast = json::parse(test::readText(report))["forecast"];
      const double seconds = medianSeconds(fmt::format("{} solve --patches-csv {} {}", FAROL_PROGRAM, csv, options), 1);
      const json r = json::parse(test::readText(report));
      measured[k] = {r["counts"]["patches"], seconds, r["peak_bytes"]};
      const std::string command = r["equivalent_command"];
      const HError e = judge.judge(csv, command, size.tolerance, reference);
      const size_t from = command.find("--rays ");
      fmt::print("| {} | {} % | {} {} | {:.2f} % (resolved to {:.2f}) | {:.2f} | {:.2f} | {:.0f} | {:.0f} |\n", measured[k].patches,
                 100 * size.tolerance, command.substr(from, command.find(' ', from + 7) - from),
                 textAfter(command, "--shadow-rays "), 100 * e.error, 100 * e.noise, seconds, forecast["seconds"].get<double>(),
                 1e-6 * measured[k].bytes, 1e-6 * forecast["peak_bytes"].get<double>());
      std::fflush(stdout);
    }
    fmt::print("from {} to {} patches seconds grow by the power {:.2f}, memory by {:.2f}\n", measured[0].patches,
               measured[1].patches, exponent(measured[0].seconds, measured[1].seconds, measured[0].patches, measured[1].patches),
               exponent(measured[0].bytes, measured[1].bytes, measured[0].patches, measured[1].patches));
  }
}
