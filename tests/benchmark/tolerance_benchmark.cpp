// What --tolerance reaches and what it costs, whole processes: the error of H against final gathering on the same patches
// (judge.h), and the time beside the fastest fixed setting of `farol chart` that reaches
// the same error by the same measure.
// farol_tolerance [seconds of reference at most, of chart, smallest tolerance, SCENE...] [--largest E] [--seeds N]; works in a
// folder of its own.
#include "base/error.h"
#include "judge.h"
#include "whole_process.h"

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

using namespace farol;
using namespace farol::benchmark;
using nlohmann::json;
using test::TemporaryFolder;

namespace {

// The options of settings on the chart that reach an error there, fastest first. A chart compares patches of all sizes on common
// cells, which evens noise out: on its own patches a setting may be worse.
std::vector<std::string> fixedSettings(const std::string& csv, double tolerance) {
  const auto lines = test::readCsv(csv);
  std::vector<std::pair<double, std::string>> settings;
  for (size_t k = 1; k < lines.size(); ++k) {
    if (std::stod(lines[k].at(lines[k].size() - 4)) <= tolerance)
      settings.emplace_back(std::stod(lines[k].at(lines[k].size() - 12)), lines[k].back());
  }
  std::sort(settings.begin(), settings.end());
  std::vector<std::string> options;
  for (const auto& [seconds, option] : settings) options.push_back(option);
  return options;
}

}  // namespace

int main(int argc, char** argv) {
  double most = 60, chartSeconds = 90, smallest = 0.002, largestTolerance = 0.05;
  int seeds = 5;
  std::vector<std::string> scenes;
  CLI::App app;
  app.add_option("reference", most);
  app.add_option("chart", chartSeconds);
  app.add_option("smallest", smallest);
  app.add_option("scenes", scenes)->check(CLI::ExistingFile);
  app.add_option("--largest", largestTolerance);
  app.add_option("--seeds", seeds)->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  if (scenes.empty()) {
    for (const char* s :
         {"cornell_box/cornell_box.gltf", "l_room/l_room.gltf", "reading_corner/reading_corner.glb",
          "white_furnace/white_furnace.gltf", "mirrors_and_glass/mirror_room.gltf", "mirrors_and_glass/facing_mirrors.gltf",
          "mirrors_and_glass/glass_block.gltf", "mirrors_and_glass/light_pipe.gltf"})
      scenes.push_back(std::string(FAROL_SCENES "/") + s);
  }
  const TemporaryFolder folder;
  const std::string csv = folder.path("p.csv"), report = folder.path("r.json");
  fmt::print(
      "| scene | tolerance | chosen | error of H, mean and largest of {} seeds | met | seconds: whole process | forecast | by the "
      "best fixed setting | ratio | best fixed setting |\n|---|---|---|---|---|---|---|---|---|---|\n",
      seeds);
  size_t runs = 0, met = 0, forecasts = 0, near = 0;
  std::string agreement;
  for (const std::string& scene : scenes) {
    const std::string name = std::filesystem::path(scene).stem();
    if (chartSeconds > 0)
      medianSeconds(fmt::format("{} chart {} -o {} --time {} --quiet 2> /dev/null", FAROL_PROGRAM, scene, folder.path("chart.svg"),
                                chartSeconds),
                    1);
    Judge judge(scene);
    const HError paths = judge.agreement(most);
    agreement +=
        fmt::format("{}: final gathering differs from gathering paths by {:.2f} % in means over surfaces (resolved to {:.2f})\n",
                    name, 100 * paths.error, 100 * paths.noise);
    for (const double tolerance : {0.05, 0.01, 0.002}) {
      if (tolerance < smallest || tolerance > largestTolerance) continue;
      double mean = 0, largest = 0, noise = 0;
      int good = 0, told = 0;
      std::string chosen;
      std::vector<double> whole, forecast;
      for (int seed = 1; seed <= seeds; ++seed) {
        const Stopwatch watch;
        const int status =
            std::system(fmt::format("{} solve {} --tolerance {} --seed {} --patches-csv {} --report {} --quiet 2> /dev/null",
                                    FAROL_PROGRAM, scene, tolerance, seed, csv, report)
                            .c_str());
        whole.push_back(watch.seconds());
        if (status != 0 && WEXITSTATUS(status) != 3) throw Error("farol solve {} failed", scene);
        const json r = json::parse(test::readText(report));
        // Of what follows the start of the process; where a plan was refined it foretold another run.
        constexpr double kNear = 1.5;
        const double taken = r["tolerance"]["seconds"];
        forecast.push_back(r["tolerance"]["predicted_seconds"]);
        if (std::max(forecast.back() / taken, taken / forecast.back()) <= kNear) ++near;
        ++forecasts;
        const std::string command = r["equivalent_command"];
        chosen =
            fmt::format("{} patches{}, {}", r["counts"]["patches"].get<int>(), r.contains("adapted") ? " of several sizes" : "",
                        command.substr(command.find("--method "), command.find(" --max-depth") - command.find("--method ")));
        const HError e = judge.judge(csv, command, tolerance, most);
        mean += e.error / seeds;
        largest = std::max(largest, e.error);
        noise = std::max(noise, e.noise);
        if (e.noise > tolerance) continue;  // the reference cannot tell
        ++told;
        if (e.error <= tolerance) ++good;
      }
      std::sort(whole.begin(), whole.end());
      std::sort(forecast.begin(), forecast.end());
      const double median = whole[whole.size() / 2];
      std::string fixed;
      double best = 0;
      for (const std::string& option :
           chartSeconds > 0 ? fixedSettings(folder.path("chart.csv"), tolerance) : std::vector<std::string>()) {
        const std::string command = fmt::format("{} solve {} {} --patches-csv {} --report {} --quiet 2> /dev/null", FAROL_PROGRAM,
                                                scene, option, csv, report);
        medianSeconds(command, 1);
        const std::string equivalent = json::parse(test::readText(report))["equivalent_command"];
        if (judge.judge(csv, equivalent, tolerance, most).error > tolerance) continue;
        fixed = option;
        best = medianSeconds(command, seeds);
        break;
      }
      runs += static_cast<size_t>(told);
      met += static_cast<size_t>(good);
      fmt::print("| {} | {} % | {} | {:.2f} and {:.2f} % (resolved to {:.2f}) | {} of {} | {:.3f} | {:.3f} | {} | {} | {} |\n",
                 name, 100 * tolerance, chosen, 100 * mean, 100 * largest, 100 * noise, good, told, median,
                 forecast[forecast.size() / 2], best > 0 ? fmt::format("{:.3f}", best) : "not reached",
                 best > 0 ? fmt::format("{:.1f}", median / best) : "", fixed.substr(0, fixed.find(" --solver")));
      std::fflush(stdout);
    }
  }
  fmt::print("\n{}", agreement);
  fmt::print("\n{} of {} runs whose reference resolves their tolerance are below it ({:.0f} %)\n", met, runs,
             100.0 * static_cast<double>(met) / static_cast<double>(std::max<size_t>(1, runs)));
  fmt::print("{} of {} forecasts of seconds are within a factor of 1.5\n", near, forecasts);
}
