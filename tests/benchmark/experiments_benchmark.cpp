// The experiments of the thesis in one table: every supplied scene by every method on the same patches, whole processes, the error
// of H against final gathering (judge.h). Names what is beaten everywhere. farol_experiments [seconds of reference at most,
// patches, SCENE...]
#include "judge.h"
#include "whole_process.h"

#include <nlohmann/json.hpp>
#include <thread>

using namespace farol;
using namespace farol::benchmark;
using nlohmann::json;
using test::TemporaryFolder;

namespace {

struct Method {
  std::string name, options;
};
const std::vector<Method> kMethods = {{"rays 1,024", "--method rays --rays 1024"},
                                      {"hemicube 64", "--method raster --resolution 64"},
                                      {"without near field", "--method raster --resolution 64 --near-field off"},
                                      {"tetrahedron 64", "--method raster --resolution 64 --projection tetrahedron"},
                                      {"4 hemicubes of 32", "--method raster --resolution 32 --positions 4"},
                                      {"hybrid 64", "--method hybrid --resolution 64"}};

constexpr int kMostSeconds = 60, kTimedOut = 124;

struct Outcome {
  bool made = false;
  double error = 0, noise = 0, seconds = 0;
};

// Whether b is as good as a at least, in less time: by more than what machines and references leave open.
bool beats(const Outcome& b, const Outcome& a) {
  constexpr double kClearly = 0.9;
  return !a.made || (b.made && b.seconds < kClearly * a.seconds && b.error < std::max(a.error, a.noise));
}

}  // namespace

int main(int argc, char** argv) {
  const double most = argc > 1 ? std::stod(argv[1]) : 30;
  const std::string patches = argc > 2 ? argv[2] : "2000";
  const TemporaryFolder folder;
  const std::string csv = folder.path("p.csv"), report = folder.path("r.json");
  std::vector<std::vector<Outcome>> outcomes(kMethods.size());
  std::string header = "| scene | facets | patches | resolved to |", line = "|---|---|---|---|";
  for (const Method& m : kMethods) {
    header += fmt::format(" {} |", m.name);
    line += "---|";
  }
  fmt::print("{}, {} threads; {} patches asked for; error of H and seconds, whole processes\n{}\n{}\n", processorName(),
             std::thread::hardware_concurrency(), patches, header, line);
  std::string device;
  std::vector<std::string> scenes(argv + std::min(argc, 3), argv + argc);
  if (scenes.empty()) {
    for (const char* file :
         {"cornell_box/cornell_box.gltf", "l_room/l_room.gltf", "reading_corner/reading_corner.glb",
          "white_furnace/white_furnace.gltf", "mirrors_and_glass/mirror_room.gltf", "mirrors_and_glass/facing_mirrors.gltf",
          "mirrors_and_glass/light_pipe.gltf", "mirrors_and_glass/glass_block.gltf"})
      scenes.push_back(std::string(FAROL_SCENES "/") + file);
  }
  for (const std::string& scene : scenes) {
    Judge judge(scene);
    json counts;
    std::string cells;
    double noise = 0;
    for (size_t m = 0; m < kMethods.size(); ++m) {
      Outcome& o = outcomes[m].emplace_back();
      const std::string command =
          fmt::format("timeout {} {} solve {} --patches {} {} --patches-csv {} --report {} --quiet 2> /dev/null", kMostSeconds,
                      FAROL_PROGRAM, scene, patches, kMethods[m].options, csv, report);
      const Stopwatch watch;
      const int status = std::system(command.c_str());
      o.made = status == 0;
      o.seconds = watch.seconds();
      if (o.made) {
        const json r = json::parse(test::readText(report));
        const HError e = judge.judge(csv, r["equivalent_command"], 0, most);
        counts = r["counts"];
        if (r.contains("device") && r["device"].contains("name")) device = r["device"]["name"];
        o.error = e.error;
        noise = o.noise = e.noise;
        constexpr double kShort = 2;  // runs that may be disturbed by others
        if (o.seconds < kShort) o.seconds = medianSeconds(command, 3);
      }
      cells += o.made                             ? fmt::format(" {:.2f} %, {:.2f} s |", 100 * o.error, o.seconds)
               : WEXITSTATUS(status) == kTimedOut ? fmt::format(" more than {} s |", kMostSeconds)
                                                  : " refused |";
    }
    fmt::print("| {} | {} | {} | {:.2f} % |{}\n", std::filesystem::path(scene).stem().string(), counts["facets"].get<int>(),
               counts["patches"].get<int>(), 100 * noise, cells);
    std::fflush(stdout);
  }
  fmt::print("\nhemicubes on {}\n", device);
  for (size_t m = 0; m < kMethods.size(); ++m) {
    bool always = true;
    for (size_t s = 0; s < outcomes[m].size(); ++s) {
      bool beaten = false;
      for (size_t other = 0; other < kMethods.size(); ++other) beaten |= other != m && beats(outcomes[other][s], outcomes[m][s]);
      always &= beaten;
    }
    if (always) fmt::print("beaten everywhere: {}\n", kMethods[m].name);
  }
}
