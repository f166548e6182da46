#include "cli/adapting.h"

#include "cli/tolerance.h"

namespace farol {

Adapting adaptTo(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method) {
  constexpr size_t kMostTried = 6000;
  constexpr uint32_t kMostLevels = 3;
  Adapting result;
  result.size = {0, options.patchSize > 0 ? options.patchSize : std::stod(fmt::format("{:.3g}", sizeForPatches(facets, facets.facets.size())))};
  const size_t largest = buildPatches(scene, facets, result.size).size();
  uint32_t level = 0;
  while (level < kMostLevels && largest << 2 * (level + 1) <= kMostTried) ++level;
  if (level == 0) return result;

  PatchOptions grid = result.size;
  grid.levels = level;
  SizedScene trial(options, scene, facets, grid);
  Setting setting;
  setting.spec = method;
  setting.emittersApart = options.emittersApart;
  setting.solver = options.solver;
  setting.residual = options.residual;
  // So many that their noise is little beside what is asked for.
  const double few = std::clamp(10.0 / options.adapt, 256.0, 8192.0);
  setting.spec.rays = static_cast<uint32_t>(few / 16) * 16;
  setting.shadowRays = setting.spec.rays / 4;
  const Trial t = trial.solve(setting);
  result.tried = trial.patches().size();
  const double order = patchErrorOf(t.f, trial.patches(), facets, t.lighting).order;
  result.adapted = adaptPatches(facets, trial.patches(), level, t.f, t.lighting.direct, t.lighting.solution, samplesOf(setting.spec), order, options.adapt);
  return result;
}

}  // namespace farol
