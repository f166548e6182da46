#include "cli/trials.h"

#include "base/machine.h"
#include "cli/choices.h"

#include <ctime>

namespace farol {

SizedScene::SizedScene(const Options& options, const Scene& scene, const FacetSet& facets, const PatchOptions& size,
                       const PatchTree& tree)
    : options_(options),
      scene_(scene),
      facets_(facets),
      patches_(buildPatches(scene, facets, size, tree)),
      log_(Log::silent()),
      methods_(options_, scene_, facets_, patches_, log_),
      lightings_(options_, facets_, methods_, log_) {}

Trial SizedScene::solve(const Setting& setting, size_t probes) {
  options_.emittersApart = setting.emittersApart;
  options_.shadowRays = setting.shadowRays;
  options_.solver = setting.solver;
  options_.residual = setting.residual;
  const Situation situation{options_, scene_, facets_, patches_, methods_};
  const StorageChoice storage = chooseStorage(situation, setting.spec);
  const std::unique_ptr<RowMaker> maker = methods_.maker(setting.spec);
  const std::clock_t cpu = std::clock();
  const Stopwatch watch;
  Trial trial{FormFactorMatrix(patches_.size(), allowedBytes(options_), storage.storage), {}};
  if (patches_.colouredSpecular()) trial.f.addChannels();
  makeFormFactors(*maker, patches_, maxChannel(options_.sky) > 0, log_, trial.f);
  Replicates replicates = replicatesOf(methods_, patches_, setting.spec, trial.f, probes);
  trial.rowSeconds = watch.seconds() - replicates.seconds;
  trial.lighting = lightings_.solve(scene_, patches_, options_.sky, trial.f, setting.spec, nullptr);
  trial.lightSeconds = watch.seconds() - trial.rowSeconds - replicates.seconds;
  trial.cpuSeconds = static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC;
  if (probes > 0) {
    const auto errorBy = [&](const DirectLight& direct, const Replicates& rows) {
      trial.lighting.error =
          irradianceError(trial.f, patches_, direct, trial.lighting.solution, rows, samplesOf(setting.spec), options_.sky);
      return relativeError(trial.f, patches_, trial.lighting);
    };
    Replicates none;
    none.patches = replicates.patches;
    trial.lightError = errorBy(trial.lighting.direct, none);
    DirectLight exact = trial.lighting.direct;
    exact.deviation.clear();
    trial.rowError = errorBy(exact, replicates);
  }
  return trial;
}

}  // namespace farol
