#include "cli/forecast.h"

#include "base/error.h"
#include "cli/choices.h"
#include "cli/factor_stage.h"
#include "cli/light_stage.h"

#include <algorithm>

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

// Memory of the process with all that rows are made by, but without rows.
uint64_t residentWithMaker(RunState& run) {
  const std::unique_ptr<RowMaker> maker = run.methods.maker(*run.spec);
  {
    FormFactorMatrix few(run.patches.size());
    const size_t atOnce = run.spec->hemicubes() ? 4 * run.methods.softwareDevices * run.methods.batch : 64;
    maker->makeRows(chooseProbes(run.patches, atOnce), few, [](size_t) {});
  }
  run.methods.tracer();
  return residentMemoryBytes();
}

// The run's own stages on fewer patches of the same scene. Facets cost the same whatever they are cut into, so that
// rows and light of a patch do.
struct StagesTried {
  size_t patches = 0, rows = 0;
  double device = 0, factors = 0, checks = 0, light = 0;  // [s]
  double entries = 0, passes = 0;                         // of F; that were made over all of them
};

StagesTried tryStages(const RunState& run, size_t count) {
  Options options = run.options;
  options.command = Command::solve;
  options.quiet = true;
  options.adapt = 0;
  if (count < run.patches.frontPatchCount) {
    options.patches = count;
    options.patchSize = 0;
  }
  RunState trial(options);
  trial.log = Log::silent();
  trial.scene = run.scene;
  trial.facets = run.facets;
  trial.spec = run.spec;
  trial.patches = count < run.patches.frontPatchCount ? buildPatches(run.scene, run.facets, patchOptionsOf(options)) : run.patches;
  trial.countPatches();
  StagesTried t;
  t.patches = trial.patches.frontPatchCount;
  trial.report.clock.finish("load");
  makeFactors(trial);
  t.rows = trial.patches.size();
  light(trial);
  const StageClock& clock = trial.report.clock;
  t.device = clock.secondsOf("device");
  t.factors = clock.secondsOf("form factors");
  t.checks = clock.secondsOf("checks");
  t.light = clock.secondsOf("solve");
  t.entries = static_cast<double>(trial.f->bytes()) / sizeof(float);
  constexpr double kOfErrors = 6;
  t.passes = static_cast<double>(trial.lighting.solution.sweeps) + kOfErrors;
  return t;
}

// What the trial took, carried to all patches: rows at the rate that was measured, rows that are made again for errors
// by their number, direct light by patches, sweeps by entries of F.
ForecastReport forecastOf(const RunState& run, const RowProbe& probe, double matrixBytes, uint64_t resident) {
  constexpr double kTrialSeconds = 0.15, kLeastTried = 400;
  // Heads of rows, lighting and errors, found at 4,000 to 300,000 patches; buffers of threads.
  constexpr double kBytesPerPatch = 1230, kFixedBytes = 5e6;
  constexpr double kSizeClasses = 1.07;  // of the heap: four per doubling
  const auto n = static_cast<double>(probe.rows);
  constexpr double kProcessSeconds = 0.01;  // to load and leave the program
  const double before = kProcessSeconds + run.report.clock.totalSeconds();
  const double some = std::max(kLeastTried, kTrialSeconds * probe.rowsPerSecond);
  const StagesTried tried = tryStages(run, some > 0.7 * n ? run.patches.frontPatchCount : static_cast<size_t>(some));
  const double more = n / static_cast<double>(tried.rows);
  const double startup = std::max(0.0, tried.factors - static_cast<double>(tried.rows) / probe.rowsPerSecond);
  const auto again = [&](double rows) {
    return (run.spec->hemicubes() ? 0.0 : kProbes * 16.0) +
           static_cast<double>(replicatedRows(static_cast<size_t>(rows), run.spec->hemicubes()));
  };
  const double sweeps = std::min(0.8 * tried.light, kSecondsPerEntry * tried.entries * tried.passes);
  ForecastReport f;
  f.tried = tried.patches;
  f.seconds = before + tried.device + (more > 1 ? startup + n / probe.rowsPerSecond : tried.factors) +
              tried.checks * again(n) / again(static_cast<double>(tried.rows)) + (tried.light - sweeps) * more +
              sweeps * matrixBytes / sizeof(float) / tried.entries;
  f.peakBytes =
      resident + static_cast<uint64_t>(kSizeClasses * matrixBytes *
                                           (1 + static_cast<double>(replicatedRows(probe.rows, run.spec->hemicubes())) / n) +
                                       kBytesPerPatch * n + kFixedBytes);
  return f;
}

// Where the trial is refused, solve would be.
void sayForecast(RunState& run, const RowProbe& probe, double matrixBytes, uint64_t resident) {
  try {
    const ForecastReport f = forecastOf(run, probe, matrixBytes, resident);
    run.say("solve would take {:.2g} s and {:.3g} MB (from {} patches)", f.seconds, 1e-6 * static_cast<double>(f.peakBytes),
            f.tried);
    run.report.forecast = f;
  } catch (const Error& e) {
    run.say("solve would be refused: {}", e.what());
  }
}

}  // namespace

// What a run would take: exact counts, memory of F and of the process, and seconds from some of its rows and patches.
void forecast(RunState& run) {
  constexpr double kProbeSeconds = 0.5;
  run.say(
      "area {:.6g} square units, {} patches emit, {} have a specular share; {} cameras, {} punctual lights, {} "
      "textures",
      run.report.area, run.report.emittingPatches, run.report.specularPatches, run.scene.cameras.size(), run.scene.lights.size(),
      run.scene.textures.size());
  for (const Camera& c : run.scene.cameras) run.say("camera '{}'", c.name);
  if (run.facets.welded > 0)
    run.say("{} vertices were moved to a neighbour within {:.3g} units", run.facets.welded, kWeldTolerance * run.facets.frame.size);
  run.say("method: {} ({})", methodText(*run.spec), run.report.why);
  const uint64_t resident = residentWithMaker(run);
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
  run.say("form factors would take {:.3g} s ({:.0f} rows/s measured)", static_cast<double>(probe.rows) / probe.rowsPerSecond,
          probe.rowsPerSecond);
  if (run.lit()) sayForecast(run, probe, storage.bytes, resident);
  run.report.clock.finish("probe");
}

}  // namespace farol
