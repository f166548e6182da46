#include "cli/tolerance_run.h"

#include "base/error.h"
#include "base/machine.h"
#include "cli/factor_stage.h"
#include "cli/light_stage.h"
#include "cli/patch_size_error.h"
#include "cli/refinement.h"

namespace farol {
namespace {

void takeAdapted(RunState& run, const Adapting& a) {
  run.patches = buildPatches(run.scene, run.facets, a.size, a.adapted.tree);
  run.methods.patchesChanged();
  run.countPatches();
  if (a.tried > 0) run.report.adapted = AdaptedReport{a.tried, a.adapted.tree.levels(), a.adapted.error};
}

void applyOptions(RunState& run) {
  run.options.patchSize = run.plan->size.size;
  run.options.cluster = run.plan->size.cluster;
  if (run.plan->size.size == 0) run.options.patches = run.plan->size.count;
  run.options.shadowRays = run.plan->setting.shadowRays;
  run.options.residual = run.plan->setting.residual;
  run.spec = run.plan->setting.spec;
  run.options.rays = run.spec->rays;
  run.options.resolution = run.spec->resolution;
  run.options.positions = run.spec->positions;
  run.options.adapt = run.plan->adapt;
  run.report.options = run.options;
}

// The options and patches of the plan. With --patches given the patches stay as they are.
void applyPlan(RunState& run) {
  applyOptions(run);
  if (run.plan->adapt > 0) {
    if (!run.plan->adapted) run.plan->adapted = adaptTo(run.options, run.scene, run.facets, *run.spec);
    takeAdapted(run, *run.plan->adapted);
    return;
  }
  run.patches = buildPatches(run.scene, run.facets, patchOptionsOf(run.options));
  run.methods.patchesChanged();
  run.countPatches();
}

// Whether rows of F have to be made again for another plan.
bool rowsDiffer(const TolerancePlan& a, const TolerancePlan& b) {
  const MethodSpec &x = a.setting.spec, &y = b.setting.spec;
  return a.size.size != b.size.size || a.size.count != b.size.count || a.adapt != b.adapt || x.rays != y.rays ||
         x.resolution != y.resolution || x.positions != y.positions;
}

// None where memory does not surely hold F: some rows tell what the others take, about.
std::optional<StorageChoice> storageThatHolds(const RunState& run) {
  constexpr double kSure = 0.9;
  try {
    const StorageChoice choice = chooseStorage(run.situation, *run.spec);
    if (choice.storage == Storage::float32 || choice.bytes <= kSure * static_cast<double>(allowedBytes(run.options))) return choice;
  } catch (const Error&) {  // says how many bytes more; fewer patches are tried instead
  }
  return std::nullopt;
}

// False, with all as it was, where memory does not hold F as the plan asks for it.
bool applyRefined(RunState& run, const TolerancePlan& next) {
  const TolerancePlan plan = *run.plan;
  const auto adapted = run.report.adapted;
  PatchSet patches = run.patches;
  run.plan = next;
  applyPlan(run);
  if (storageThatHolds(run)) return true;
  run.plan = plan;
  applyOptions(run);
  run.report.adapted = adapted;
  run.patches = std::move(patches);
  run.methods.patchesChanged();
  run.countPatches();
  return false;
}

double patchError(const RunState& run) {
  if (run.plan->adapted) return adaptedPatchErrorOf(*run.f, run.patches, run.facets, run.lighting, *run.plan->adapted);
  PatchOptions size = patchOptionsOf(run.options);
  if (size.cluster == 0) return patchErrorOf(*run.f, run.patches, run.facets, run.lighting).error;
  if (size.size == 0) size.size = sizeForClusters(run.facets, size.count);
  return gatheredPatchErrorOf(*run.f, run.patches, run.scene, run.facets, run.lighting, size).error;
}

ErrorParts errorParts(RunState& run) {
  ErrorParts e;
  e.patches = patchError(run);
  Replicates none;
  none.patches = run.replicates.patches;
  const auto by = [&](const DirectLight& direct) {
    const std::vector<Rgb> kept = run.lighting.error;
    run.lighting.error =
        irradianceError(*run.f, run.patches, direct, run.lighting.solution, none, samplesOf(*run.spec), run.options.sky);
    const double error = relativeError(*run.f, run.patches, run.lighting);
    run.lighting.error = kept;
    return error;
  };
  DirectLight exact = run.lighting.direct;
  exact.deviation.clear();
  e.sweeps = by(exact);
  const double lightAndSweeps = by(run.lighting.direct), all = *run.report.estimatedError;
  e.light = std::sqrt(std::max(0.0, lightAndSweeps * lightAndSweeps - e.sweeps * e.sweeps));
  e.rows = std::sqrt(std::max(0.0, all * all - lightAndSweeps * lightAndSweeps));
  return e;
}

// Rows of many samples cost less per sample than the trial's of few: where it matters some of the plan's own rows tell.
void tellRowSeconds(RunState& run) {
  constexpr double kWorthAProbe = 0.4, kProbeSeconds = 0.02, kAgain = 1.1;
  TolerancePlan& plan = *run.plan;
  if (plan.rowSeconds < kWorthAProbe) return;
  const RowProbe probe = probeRows(run.situation, *run.spec, kProbeSeconds);
  const double rowSeconds = kAgain * static_cast<double>(probe.rows) / probe.rowsPerSecond;
  plan.seconds += rowSeconds - plan.rowSeconds;
  plan.rowSeconds = rowSeconds;
}

}  // namespace

void adapt(RunState& run) {
  const Adapting a = adaptTo(run.options, run.scene, run.facets, *run.spec);
  run.options.patchSize = run.report.options.patchSize = a.size.size;
  takeAdapted(run, a);
  run.report.clock.finish("adapting");
  if (a.tried == 0) {
    run.say("patches: {} facets are too many to try smaller ones: all stay as large as --patch-size {}", run.facets.facets.size(),
            run.options.patchSize);
    return;
  }
  if (a.adapted.error > run.options.adapt) {
    run.log.warn({"adapt-not-met",
                  fmt::format("the smallest patches are {} times smaller than the largest, and still constant patches "
                              "are predicted to cost {:.2g} % of H: {:.2g} % was asked for",
                              1u << PatchTree::kMostLevels, 100 * a.adapted.error, 100 * run.options.adapt),
                  {},
                  a.adapted.error});
  }
  run.say("patches: {} of {} sizes, from {} of a trial; constant patches are predicted to cost {:.2g} % of H", run.patches.size(),
          a.adapted.tree.levels() + 1, a.tried, 100 * a.adapted.error);
}

void choosePlan(RunState& run) {
  // A plan knows only about what rows will take, mostly where light goes over mirrors: with less memory where that was too little.
  constexpr int kTries = 6;
  Options options = run.options;
  const MethodSpec method = *run.spec;
  std::optional<StorageChoice> storage;
  for (int k = 0; k < kTries && !storage; ++k) {
    try {
      run.plan = planFor(options, run.scene, run.facets, method);
    } catch (const Error&) {  // not even a trial fits
      if (k == 0) throw;
      break;
    }
    applyPlan(run);
    storage = storageThatHolds(run);
    if (!storage && options.gave("--patches")) break;
    options.memory = allowedBytes(options) / 2;
  }
  if (!storage) storage = chooseStorage(run.situation, *run.spec);
  tellRowSeconds(run);
  run.plan->choices.push_back(
      {"storage", storage->storage == Storage::bits16 ? "16 bits, or lists of entries" : "float32, or lists", storage->why});
  run.report.clock.finish("choosing");
  run.say("tolerance {:.3g} %: {:.2g} % predicted, in {:.2g} s:", 100 * run.options.tolerance, 100 * run.plan->predicted.total(),
          run.plan->seconds);
  for (const Choice& c : run.plan->choices) run.say("  {}: {} ({})", c.what, c.value, c.why);
}

// Chooses, solves, and refines where the estimate of what was reached says so. What patches cost is told by joining them: where
// smaller ones of one size cost more than larger ones foretold, as with gaps that are much thinner than they, there may be more
// that joining does not see yet, and a tolerance that is just met is not believed.
void meetTolerance(RunState& run) {
  constexpr int kRounds = 4;
  constexpr double kGrew = 1.6, kBelieved = 0.95;  // times what was expected; of the tolerance
  constexpr double kLong = 0.5;                    // [s]
  const Stopwatch watch;
  choosePlan(run);
  // What trials leave lies in pieces that rows do not all fit into. To give it back takes some hundredths of a second.
  if (run.plan->seconds > kLong) returnFreedMemory();
  ErrorParts found;
  double expected = run.plan->predicted.patches;
  bool newRows = true;
  for (int round = 0;; ++round) {
    if (newRows) makeFactors(run);
    if (round == 0) chooseSolvePlace(run);
    light(run);
    found = errorParts(run);
    run.report.estimatedError = found.total();
    run.report.clock.finish("errors");
    const bool grew = !run.plan->adapted && found.patches > kGrew * expected && found.patches > 0.5 * run.options.tolerance;
    const bool met = found.total() <= (grew ? kBelieved : 1) * run.options.tolerance;
    if (met || round + 1 == kRounds || !run.plan->limitedBy.empty()) break;
    expected = found.patches;
    const auto limitedBy = [&](const char* what) { run.plan->limitedBy = found.total() > run.options.tolerance ? what : ""; };
    TolerancePlan next = refined(*run.plan, run.options, run.facets, found, grew);
    const bool changed = rowsDiffer(next, *run.plan) || next.setting.shadowRays != run.plan->setting.shadowRays;
    if (!changed) {
      limitedBy("the options given");
      break;
    }
    if (run.options.time > 0 && 2 * watch.seconds() > run.options.time) {
      limitedBy("time");
      break;
    }
    adaptInstead(next, *run.plan, run.options, run.scene, run.facets, found, run.patches.size());
    run.say("refined: the error is estimated as {:.2g} % (patches {:.2g}, rows {:.2g}, light {:.2g})", 100 * found.total(),
            100 * found.patches, 100 * found.rows, 100 * found.light);
    const TolerancePlan before = *run.plan;
    newRows = rowsDiffer(next, before);
    if (!newRows) {
      run.plan = next;
      applyOptions(run);
    } else if (!applyRefined(run, next)) {
      limitedBy("memory");
      break;
    }
    for (const Choice& c : takeRefined(*run.plan, before, found, run.patches.size()))
      run.say("  {}: {} ({})", c.what, c.value, c.why);
    run.lighting = {};
    if (!newRows) continue;
    run.report.checks.reset();
    run.replicates = {};
  }
  run.report.tolerance =
      ToleranceReport{run.options.tolerance, found.total() <= run.options.tolerance, *run.plan, found, watch.seconds()};
  if (!run.report.tolerance->met) {
    run.log.warn(
        {"tolerance-not-met",
         fmt::format("the tolerance of {:.3g} % is not met: the error of H is estimated as {:.2g} %{}", 100 * run.options.tolerance,
                     100 * found.total(), run.plan->limitedBy.empty() ? "" : "; limited by " + run.plan->limitedBy),
         {},
         found.total()});
  }
}

}  // namespace farol
