// The error of H that a run of the program has reached, against gathering paths on the same patches (front sides).
#pragma once

#include "cli/adapting.h"
#include "reference/gathering.h"
#include "test_scene.h"

#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <sstream>

namespace farol::benchmark {

// What follows an option, or nothing.
inline std::string textAfter(const std::string& command, const std::string& option) {
  const size_t at = command.find(option);
  return at == std::string::npos ? "" : command.substr(at, command.find(' ', at + option.size()) - at);
}

// One scene and references on the patches that were asked about.
class Judge {
 public:
  explicit Judge(const std::string& path) : log_(true), scene_(loadScene(path, log_)), facets_(buildFacets(scene_, log_)), tracer_(facets_) {}

  // Of the H of a --patches-csv file, on the patches of a command that repeats the run.
  HError judge(const std::string& csv, const std::string& command, double tolerance, double seconds) {
    // Patches of several sizes depend on the seed of their trial.
    const std::string adapted = textAfter(command, "--adapt ");
    auto& known = known_[textAfter(command, "--patch-size ") + textAfter(command, "--patches ") + textAfter(command, "--cluster ") + adapted + (adapted.empty() ? "" : textAfter(command, "--seed "))];
    if (!known) known = std::make_unique<Known>(Known{patchesOf(command), {}, 0});
    PatchSet& patches = known->patches;
    std::vector<Rgb> h(patches.size(), Rgb(0));
    const auto lines = test::readCsv(csv);
    for (size_t i = 0; i < patches.frontPatchCount; ++i) {
      for (size_t c = 0; c < 3; ++c) h[i][static_cast<int>(c)] = std::stod(lines.at(i + 1).at(18 + c));
    }
    HError error;
    constexpr double kResolved = 5;
    for (double more = 2; known->spent == 0 || ((error = of(h, *known)).noise > std::max(tolerance, error.error) / kResolved && known->spent < seconds); more *= 2) {
      known->truth = gather(patches, more);
      known->spent = more;
    }
    return of(h, *known);
  }

 private:
  struct Known {
    PatchSet patches;
    GatheredIrradiance truth;
    double spent = 0;
  };
  static HError of(const std::vector<Rgb>& h, const Known& known) {
    GatheredIrradiance fronts = known.truth;
    for (size_t i = known.patches.frontPatchCount; i < fronts.exposed.size(); ++i) fronts.exposed[i] = 0;
    return errorOf(h, known.patches, fronts);
  }
  PatchSet patchesOf(const std::string& command) const {
    std::istringstream words(command);
    std::vector<std::string> arguments{std::istream_iterator<std::string>(words), {}};
    std::vector<char*> argv;
    for (std::string& a : arguments) argv.push_back(a.data());
    bool handled = false;
    const Options o = parseOptions(static_cast<int>(argv.size()), argv.data(), handled);
    if (o.adapt == 0) return buildPatches(scene_, facets_, patchOptionsOf(o));
    MethodSpec method;
    method.seed = o.seed;
    const Adapting a = adaptTo(o, scene_, facets_, method);
    return buildPatches(scene_, facets_, a.size, a.adapted.tree);
  }
  GatheredIrradiance gather(const PatchSet& patches, double seconds) const {
    const LampPlan lamps = chooseLamps(facets_, patches, {});
    const PathGatherer gatherer(tracer_, facets_, patches, scene_, lamps, Rgb(0), {});
    const PatchSet* set = &patches;
    return gatherIrradiance(gatherer, tracer_, facets_, std::span(&set, 1), seconds, 77, [](double) {})[0];
  }

  Log log_;
  Scene scene_;
  FacetSet facets_;
  Tracer tracer_;
  std::map<std::string, std::unique_ptr<Known>> known_;
};

}  // namespace farol::benchmark
