#include "cli/adapting.h"

#include "cli/choices.h"
#include "cli/patch_size_error.h"

#include <bit>

namespace farol {

Adapting adaptTo(const Options& options, const Scene& scene, const FacetSet& facets, const MethodSpec& method) {
  constexpr size_t kMostTried = 6000;
  constexpr uint32_t kMostLevels = 3;
  Adapting result;
  result.size = {0, options.patchSize > 0 ? options.patchSize : std::stod(fmt::format("{:.3g}", sizeForPatches(facets, facets.facets.size())))};
  // Rays so many that their noise is little beside what is asked for.
  const double few = std::clamp(10.0 / options.adapt, 256.0, 6000.0);
  const uint32_t rays = std::bit_floor(static_cast<uint32_t>(1.4 * few));
  const size_t largest = buildPatches(scene, facets, result.size).size();
  const auto fits = [&](size_t patches) {
    return patches <= kMostTried && static_cast<double>(patches) * std::min(4.0 * rays, 2.0 * static_cast<double>(patches)) < static_cast<double>(allowedBytes(options));
  };
  uint32_t level = 0;
  while (level < kMostLevels && fits(largest << 2 * (level + 1))) ++level;
  if (level == 0) return result;

  PatchOptions grid = result.size;
  grid.levels = level;
  SizedScene trial(options, scene, facets, grid);
  Setting setting;
  setting.spec = method;
  setting.spec.kind = MethodSpec::Kind::rays;
  setting.emittersApart = options.emittersApart;
  setting.solver = options.solver;
  setting.residual = options.residual;
  setting.spec.rays = rays;
  setting.shadowRays = rays / 4;
  const Trial t = trial.solve(setting);
  result.tried = trial.patches().size();
  result.order = patchErrorOf(t.f, trial.patches(), facets, t.lighting).order;
  result.adapted = adaptPatches(facets, trial.patches(), level, t.f, t.lighting.direct, t.lighting.solution, samplesOf(setting.spec), result.order, options.adapt);
  return result;
}

}  // namespace farol
