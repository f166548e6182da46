#include "cli/forecast.h"

#include "cli/choices.h"
#include "cli/factor_stage.h"

namespace farol {
namespace {

// Share of what patches see that is a mirror or glass: some rows by rays.
double seenFirstAsSpecular(RunState& run) {
  if (!run.patches.anySpecular()) return 0;
  MethodSpec few = specFrom(run.options, MethodSpec::Kind::rays);
  few.rays = 256;
  FormFactorMatrix rows(run.patches.size());
  const std::vector<uint32_t> probes = chooseProbes(run.patches, 64);
  run.methods.maker(few)->makeRows(probes, rows, [](size_t) {});
  double share = 0;
  for (const uint32_t i : probes) share += rows.shares(i).specular / static_cast<double>(probes.size());
  return share;
}

}  // namespace

// What a run would take: exact counts, memory of F, and seconds from half a second of probe rows.
void forecast(RunState& run) {
  constexpr double kProbeSeconds = 0.5;
  run.say(
      "area {:.6g} square units, {} patches emit, {} have a specular share; {} cameras, {} punctual lights, {} "
      "textures",
      run.report.area, run.report.emittingPatches, run.report.specularPatches, run.scene.cameras.size(),
      run.scene.lights.size(), run.scene.textures.size());
  for (const Camera& c : run.scene.cameras) run.say("camera '{}'", c.name);
  if (run.facets.welded > 0)
    run.say("{} vertices were moved to a neighbour within {:.3g} units", run.facets.welded,
            kWeldTolerance * run.facets.frame.size);
  run.say("method: {} ({})", methodText(*run.spec), run.report.why);
  const RowProbe probe = probeRows(run.situation, *run.spec, kProbeSeconds);
  StorageChoice storage = chooseStorage(run.situation, *run.spec);
  if (storage.storage == Storage::float32) storage.bytes = probe.bytesPerRow * static_cast<double>(probe.rows);
  run.report.matrixBytes = static_cast<uint64_t>(storage.bytes);
  run.report.storageWhy = storage.why;
  run.say("form factors would take {:.4g} MB; {:.4g} MB are allowed ({})", storage.bytes * 1e-6,
          static_cast<double>(allowedBytes(run.options)) * 1e-6, storage.why);
  sayModel(run, seenFirstAsSpecular(run));
  const LampPlan plan = run.lightings.plan(run.patches, *run.spec);
  run.report.lamps = plan.lamps.size();
  run.report.emitters = plan.emitters;
  run.report.lampsWhy = plan.why;
  if (run.report.emittingPatches > 0) run.say("emitters: {}", plan.why);
  run.say("form factors would take {:.3g} s ({:.0f} rows/s measured)",
          static_cast<double>(probe.rows) / probe.rowsPerSecond, probe.rowsPerSecond);
  run.report.clock.finish("probe");
}

}  // namespace farol
