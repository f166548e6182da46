#include "cli/factor_stage.h"

#include "cli/warnings.h"
#include "formfactor/error_model.h"

#include <algorithm>
#include <future>

namespace farol {
namespace {

void reportStorage(RunState& run) {
  run.report.matrixBytes = run.f->bytes();
  run.report.coloured = run.f->coloured();
  run.report.denseRows = run.f->denseRows();
  run.report.packedRows = run.f->packedRows();
  run.report.packingError = run.f->packingError();
}

// What is known of errors stays that of the rows as they were made.
void repair(RunState& run) {
  run.report.repair = repairRows(*run.f, run.patches);
  reportStorage(run);
  const Repair& r = *run.report.repair;
  run.say(
      "repair: {} sweeps; entries and their mirror images differed by {:.2g} % in all, rows changed by {:.2g} (mean "
      "L1), {:.2g} at most; sums within {:.1g}",
      r.sweeps, 100 * r.asymmetry, r.meanChange, r.largestChange, r.closure);
}

// Their differences to F's rows tell the error of H. Of patches that may yet be left out, proportionally more.
void replicateRows(RunState& run, bool allKept = true) {
  const size_t all = run.patches.size(), count = replicatedRows(all, run.spec->hemicubes());
  run.replicates =
      replicatesOf(run.methods, run.patches, *run.spec, *run.f, allKept ? count : count * all / run.patches.frontPatchCount);
}

// Rows of all patches become those of the patches `kept`.
void keepOf(const std::vector<uint32_t>& kept, Replicates& replicates) {
  replicates.rows->keep(kept);
  std::vector<uint32_t> patches;
  for (const uint32_t old : replicates.patches) {
    const auto place = std::lower_bound(kept.begin(), kept.end(), old);
    if (place != kept.end() && *place == old) patches.push_back(static_cast<uint32_t>(place - kept.begin()));
  }
  replicates.patches = std::move(patches);
}

void reportRowErrors(RunState& run) {
  double area = 0;
  run.report.rowErrorMean = run.report.rowErrorMax = 0;
  for (const uint32_t i : chooseProbes(run.patches, 256)) {
    const double a = run.patches.patches[i].area * run.f->shares(i).exposed, error = run.model.rowError(i);
    run.report.rowErrorMean += a * error;
    run.report.rowErrorMax = std::max(run.report.rowErrorMax, error);
    area += a;
  }
  if (area > 0) run.report.rowErrorMean /= area;
}

}  // namespace

size_t replicatedRows(size_t patches, bool hemicubes) {
  constexpr size_t kFewest = 384, kMost = 16384, kShare = 16;
  return std::clamp(patches / kShare, hemicubes ? kFewest / 2 : kFewest, kMost);
}

void makeFactors(RunState& run) {
  const StorageChoice storage = chooseStorage(run.situation, *run.spec);
  run.report.storageWhy = storage.why;
  run.f.emplace(run.patches.size(), allowedBytes(run.options), storage.storage);
  if (run.patches.colouredSpecular()) run.f->addChannels();
  if (run.spec->hemicubes()) {
    // Opening a device is one core's work; rays find meanwhile what will tell the errors of its rows.
    std::future<void> device = std::async(std::launch::async, [&] { run.methods.device(); });
    replicateRows(run, false);
    run.report.clock.finish("checks");
    device.get();
    run.report.clock.finish("device");
  }
  const std::unique_ptr<RowMaker> maker = run.methods.maker(*run.spec);
  // A kept F, or one for many lightings, may be lit from anywhere: it has a row for every patch.
  const bool all = maxChannel(run.options.sky) > 0 || run.options.output.ends_with(".npz") || !run.variants.empty();
  const std::vector<uint32_t> kept = makeFormFactors(*maker, run.patches, all, run.log, *run.f);
  if (run.replicates.rows && !kept.empty()) keepOf(kept, run.replicates);
  run.countPatches();
  reportStorage(run);
  run.report.clock.finish("form factors");
  const bool few = run.options.tolerance > 0;
  const ProbeRows probes = run.spec->hemicubes()
                               ? ProbeRows{run.replicates.patches, {*run.replicates.rows}, {}}
                               : makeProbes(run.methods, run.patches, *run.spec, *run.f, few ? kProbes / 3 : kProbes, few ? 4 : 16);
  run.model = fitErrorModel(*run.f, run.patches, probes, samplesOf(*run.spec));
  if (!run.spec->hemicubes()) replicateRows(run);
  if (run.spec->kind == MethodSpec::Kind::exact) run.model = {};
  if (run.options.repair) repair(run);
  run.report.errorModel = run.model;
  run.report.checks = checkFormFactors(*run.f, run.patches);
  sayModel(run, run.report.checks->specular);
  reportRowErrors(run);
  warnOfBrokenRules(*run.report.checks, *run.f, run.model, run.patches, run.scene, run.log);
  run.report.clock.finish("checks");
  if (run.methods.deviceOpen()) {
    run.report.device = run.methods.device().info();
    run.report.devices = run.methods.softwareDevices;
    run.report.batch = run.methods.batch;
    run.report.deviceBytes = run.methods.deviceBytes;
  }
  const double seconds = run.report.clock.secondsOf("form factors");
  run.say(
      "form factors: {}: {} rows in {:.2f} s ({:.0f} rows/s), row sums {:.6f} to {:.6f}, {:.3g} % missed the scene, "
      "{:.3g} % met backs; row error {:.2g} (mean L1, estimated)",
      methodText(*run.spec), run.patches.size(), seconds, static_cast<double>(run.patches.size()) / seconds,
      run.report.checks->rowSumMin, run.report.checks->rowSumMax, 100 * run.report.checks->missed, 100 * run.report.checks->backs,
      run.report.rowErrorMean);
  if (run.f->packedRows() > 0) {
    run.say("storage: {} of {} rows in 16 bits ({}), L1 error of a row at most {:.2g} by it", run.f->packedRows(), run.f->size(),
            storage.why, run.f->packingError());
  }
}

// F as it was kept. How good its rows are was told when they were made.
void loadFactors(RunState& run) {
  run.f.emplace(run.kept->load(run.patches.size(), allowedBytes(run.options)));
  run.report.storageWhy = "as kept";
  reportStorage(run);
  if (auto again = run.kept->replicates(run.patches.size())) {
    run.replicates.patches = std::move(again->patches);
    run.replicates.rows = std::move(again->rows);
    run.replicates.better = run.spec->hemicubes();
  }
  run.report.clock.finish("form factors");
  if (!run.replicates.rows) replicateRows(run);
  run.report.checks = checkFormFactors(*run.f, run.patches);
  run.report.clock.finish("checks");
  run.say("form factors: {} rows of {} in {:.2f} s from {}", run.f->size(), run.kept->about().method,
          run.report.clock.secondsOf("form factors"), run.options.factors);
}

// Which parts of the model the scene asks for, and what mirrors and glass are worth.
void sayModel(RunState& run, double metSpecular) {
  double passed = 0, area = 0, grey = 0;
  for (const Patch& p : run.patches.patches) {
    grey = std::max(grey, maxChannel(p.reflectance + p.emission) - minChannel(p.reflectance + p.emission));
    if (!p.isSpecular()) continue;
    passed += p.area * maxChannel(p.specular());
    area += p.area;
  }
  run.report.model = {grey > 0 || maxChannel(run.options.sky) > minChannel(run.options.sky), run.patches.anySpecular(),
                      run.patches.colouredSpecular(), area > 0 ? metSpecular * passed / area : 0};
  if (!run.patches.anySpecular()) return;
  run.say(
      "mirrors and glass: {} patches; {:.2g} % of what patches see first; left out, H would change by about {:.2g} % "
      "of its mean{}",
      run.report.specularPatches, 100 * metSpecular, 100 * run.report.model.withoutSpecular,
      run.patches.colouredSpecular() ? "; coloured: one F per channel" : "");
}

}  // namespace farol
