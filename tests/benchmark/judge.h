// The error of H that a run of the program has reached, on the same patches (front sides). The reference is final gathering from
// random points of every patch: direct light there by shadow rays, and one ray to a surface, where direct light is sampled again
// and a much finer solution of the scene says what else there is; what glass and mirrors without images of the lamps pass on of
// them straight to a patch is followed from them. What that solution errs by reaches a patch as a mean over all directions; how far
// it does, gathering paths tell that follow light to its end, in means over surfaces (agreement).
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
  explicit Judge(const std::string& path)
      : log_(true), scene_(loadScene(path, log_)), facets_(buildFacets(scene_, log_)), tracer_(facets_) {
    options_.command = Command::solve;
    options_.scene = path;
    Setting setting;
    setting.spec.rays = 2048;
    setting.shadowRays = 128;
    constexpr size_t kPatches = 24000;
    fine_ = std::make_unique<SizedScene>(options_, scene_, facets_, PatchOptions{kPatches, 0});
    const Trial fine = fine_->solve(setting);
    known_ = fine.lighting.solution.irradiance;
    for (size_t i = 0; i < known_.size(); ++i) exposed_.push_back(fine.f.shares(i).exposed);
  }

  // Final gathering against gathering paths, so many seconds each: means over surfaces.
  HError agreement(double seconds) const {
    const PatchSet coarse = buildPatches(scene_, facets_, {2000, 0});
    const auto bySurface = [&](const GatheredIrradiance& g) {
      GatheredIrradiance means;
      for (auto& half : means.half) half.assign(scene_.surfaces.size(), Rgb(0));
      means.exposed.assign(scene_.surfaces.size(), 0.0);
      for (size_t i = 0; i < coarse.frontPatchCount; ++i) {
        const Patch& p = coarse.patches[i];
        const double area = p.area * g.exposed[i];
        means.exposed[p.surface] += area;
        for (size_t h = 0; h < 2; ++h) means.half[h][p.surface] += area * g.half[h][i];
      }
      for (size_t s = 0; s < means.exposed.size(); ++s) {
        for (auto& half : means.half) half[s] /= std::max(means.exposed[s], 1e-300);
      }
      return means;
    };
    GatheredIrradiance paths = bySurface(gather(coarse, seconds, false));
    const GatheredIrradiance found = bySurface(gather(coarse, seconds, true));
    PatchSet surfaces;
    surfaces.patches.resize(scene_.surfaces.size());
    std::vector<Rgb> mean(scene_.surfaces.size());
    for (size_t s = 0; s < mean.size(); ++s) {
      surfaces.patches[s].area = paths.exposed[s];
      mean[s] = 0.5 * (found.half[0][s] + found.half[1][s]);
      paths.exposed[s] = paths.exposed[s] > 0 ? 1 : 0;
    }
    return errorOf(mean, surfaces, paths);
  }

  // Of the H of a --patches-csv file, on the patches of a command that repeats the run.
  HError judge(const std::string& csv, const std::string& command, double tolerance, double seconds) {
    // Patches of several sizes depend on the seed of their trial.
    const std::string adapted = textAfter(command, "--adapt ");
    auto& known = references_[textAfter(command, "--patch-size ") + textAfter(command, "--patches ") +
                              textAfter(command, "--cluster ") + adapted + (adapted.empty() ? "" : textAfter(command, "--seed "))];
    if (!known) known = std::make_unique<Known>(Known{patchesOf(command), {}, 0});
    PatchSet& patches = known->patches;
    std::vector<Rgb> h(patches.size(), Rgb(0));
    const auto lines = test::readCsv(csv);
    for (size_t i = 0; i < patches.frontPatchCount; ++i) {
      for (size_t c = 0; c < 3; ++c) h[i][static_cast<int>(c)] = std::stod(lines.at(i + 1).at(18 + c));
    }
    HError error;
    constexpr double kResolved = 5;
    for (double more = 2; known->spent == 0 ||
                          ((error = of(h, *known)).noise > std::max(tolerance, error.error) / kResolved && known->spent < seconds);
         more *= 2) {
      known->truth = gather(patches, more, true);
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
  GatheredIrradiance gather(const PatchSet& patches, double seconds, bool finally) const {
    const LampPlan lamps = chooseLamps(facets_, patches, {});
    PathGatherer gatherer(tracer_, facets_, patches, scene_, lamps, Rgb(0), {});
    if (finally) {
      gatherer.endWith(fine_->patches(), known_, exposed_);
      gatherer.leaveOutFollowed();
    }
    const PatchSet* set = &patches;
    const double gathering = gatherer.leavesOut() ? 0.5 * seconds : seconds;
    GatheredIrradiance g = gatherIrradiance(gatherer, tracer_, facets_, std::span(&set, 1), gathering, 77, [](double) {})[0];
    addFollowed(gatherer, patches, seconds - gathering, 78, g);
    return g;
  }

  Log log_;
  Options options_;
  Scene scene_;
  FacetSet facets_;
  Tracer tracer_;
  std::unique_ptr<SizedScene> fine_;
  std::vector<Rgb> known_;       // H of its patches
  std::vector<double> exposed_;  // share of each on which nothing stands
  std::map<std::string, std::unique_ptr<Known>> references_;
};

}  // namespace farol::benchmark
