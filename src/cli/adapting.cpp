#include "cli/adapting.h"

#include "cli/choices.h"
#include "cli/patch_size_error.h"

#include <bit>

namespace farol {

AdaptTrial adaptTrialOf(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method) {
  constexpr size_t kMostTried = 6000;
  constexpr uint32_t kMostLevels = 3;
  AdaptTrial trial;
  trial.size = {0, options.patchSize > 0 ? options.patchSize : rounded(sizeForPatches(facets, facets.facets.size()))};
  // Rays so many that their noise is little beside what is asked for.
  const double few = std::clamp(10.0 / options.adapt, 256.0, 6000.0);
  const uint32_t rays = std::bit_floor(static_cast<uint32_t>(1.4 * few));
  const size_t largest = buildPatches(scene, facets, trial.size).size();
  const auto fits = [&](size_t patches) {
    return patches <= kMostTried && static_cast<double>(patches) * std::min(4.0 * rays, 2.0 * static_cast<double>(patches)) <
                                        static_cast<double>(allowedBytes(options));
  };
  while (trial.level < kMostLevels && fits(largest << 2 * (trial.level + 1))) ++trial.level;
  trial.patches = largest << 2 * trial.level;
  trial.setting.spec = method;
  trial.setting.spec.kind = MethodSpec::Kind::rays;
  trial.setting.spec.rays = rays;
  trial.setting.emittersApart = options.emittersApart;
  trial.setting.shadowRays = rays / 4;
  trial.setting.solver = options.solver;
  trial.setting.residual = options.residual;
  return trial;
}

Adapting adaptTo(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method) {
  const AdaptTrial trial = adaptTrialOf(options, scene, facets, method);
  Adapting result;
  result.size = trial.size;
  if (trial.level == 0) return result;
  PatchOptions grid = trial.size;
  grid.levels = trial.level;
  SizedScene sized(options, scene, facets, grid);
  const Trial t = sized.solve(trial.setting);
  result.tried = sized.patches().size();
  result.order = patchErrorOf(t.f, sized.patches(), facets, t.lighting).order;
  result.adapted = adaptPatches(facets, sized.patches(), trial.level, t.f, t.lighting.direct, t.lighting.solution,
                                samplesOf(trial.setting.spec), result.order, options.adapt);
  return result;
}

}  // namespace farol
