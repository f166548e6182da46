#include "cli/variants_run.h"

#include "cli/light_stage.h"
#include "cli/results.h"

#include <algorithm>

namespace farol {
namespace {

// The scene as the variant has it; patches keep their places.
void change(RunState& run, const Scene& base, const Variant& variant) {
  run.scene = changed(base, variant);
  run.patches = buildPatches(run.scene, run.facets, patchOptionsOf(run.options));
}

}  // namespace

void solveVariants(RunState& run) {
  const Scene base = run.scene;
  const Options options = run.options;
  std::vector<UnitLighting> units = unitLightings(base, run.variants);
  const auto alike = static_cast<size_t>(
      std::count_if(run.variants.begin(), run.variants.end(), [](const Variant& v) { return v.emissionOnly(); }));
  if (units.size() >= alike) units.clear();  // not worth it
  std::vector<Lighting> made;
  for (const UnitLighting& unit : units) {
    const PatchSet patches = buildPatches(unit.scene, run.facets, patchOptionsOf(run.options));
    made.push_back(run.lightings.make(unit.scene, patches, unit.material ? Rgb(0) : run.options.sky, *run.f, *run.spec,
                                      run.replicates, run.solveDevice));
    leaveFailedDevice(run, made.back().solution);
  }
  run.report.clock.finish("unit solutions");
  bool converged = true;
  for (const Variant& variant : run.variants) {
    change(run, base, variant);
    run.lighting = {};
    const bool combined = variant.emissionOnly() && !units.empty();
    if (combined) {
      for (size_t k = 0; k < units.size(); ++k) {
        const Rgb factor = factorOf(units[k], variant, base);
        if (maxChannel(factor) > 0) add(run.lighting, made[k], factor);
      }
      if (run.lighting.solution.irradiance.empty()) add(run.lighting, made.back(), Rgb(0));
    } else {
      run.lighting =
          run.lightings.make(run.scene, run.patches, run.options.sky, *run.f, *run.spec, run.replicates, run.solveDevice);
      leaveFailedDevice(run, run.lighting.solution);
    }
    reportSolution(run);
    converged &= run.lighting.solution.converged;
    run.report.variants.push_back(
        {variant.name, combined ? units.size() : 0, run.lighting.solution.sweeps, run.lighting.solution.converged,
         *run.report.estimatedError, run.report.energy->relativeError,
         luminance(run.report.energy->emitted + run.report.energy->fromSky + run.report.energy->fromPunctual)});
    run.report.clock.finish("variants");
    for (std::string Options::*path : {&Options::output, &Options::patchesCsv, &Options::sensorsOut})
      run.options.*path = variantPath(options.*path, variant);
    const bool quiet = run.options.quiet;
    run.options.quiet = true;  // one line per variant is enough
    writeResults(run);
    run.options.quiet = quiet;
    run.say("variant '{}': {}, error of H {:.2g} of its mean (estimated), energy within {:.2g} %", variant.name,
            combined ? fmt::format("from {} unit solutions", units.size())
                     : fmt::format("solved in {} sweeps", run.lighting.solution.sweeps),
            *run.report.estimatedError, 100 * run.report.energy->relativeError);
  }
  run.options = options;
  run.report.solution->converged = converged;
}

}  // namespace farol
