#include "cli/run_state.h"

#include "base/error.h"
#include "cli/choices.h"
#include "cli/warnings.h"

namespace farol {

RunState::RunState(const Options& o)
    : options(o),
      log(o.quiet),
      methods(options, scene, facets, patches, log),
      situation{options, scene, facets, patches, methods},
      lightings(options, facets, methods, log) {
  report.options = o;
}

void RunState::countPatches() {
  report.cells = patches.cells.size();
  report.patches = patches.size();
  report.area = 0;
  report.specularPatches = report.emittingPatches = 0;
  for (const Patch& p : patches.patches) {
    report.area += p.area;
    if (p.isSpecular()) ++report.specularPatches;
    if (p.emits()) ++report.emittingPatches;
  }
}

bool RunState::lit() const { return report.emittingPatches > 0 || maxChannel(options.sky) > 0 || !scene.lights.empty(); }

void load(RunState& run) {
  run.scene = loadScene(run.options.scene, run.log);
  run.report.surfaces = run.scene.surfaces.size();
  for (const Surface& s : run.scene.surfaces) run.report.triangles += s.triangles.size();
  if (run.options.command == Command::render || (run.options.command == Command::compare && !run.options.output.empty()))
    run.camera = chooseCamera(run.scene, run.options.camera);
  if (!run.options.variants.empty()) run.variants = loadVariants(run.options.variants, run.scene);
  run.report.clock.finish("load");
}

// The file of factors also says which patches they are for.
void openKept(RunState& run) {
  run.kept.emplace(run.options.factors);
  const PatchOptions& p = run.kept->about().patches;
  if ((run.options.gave("--patches") || run.options.gave("--patch-size")) &&
      (p.size != run.options.patchSize || (p.size == 0 && p.count != run.options.patches))) {
    throw Error("{}: these factors are for {}; leave --patches and --patch-size out", run.options.factors,
                p.size > 0 ? fmt::format("--patch-size {}", p.size) : fmt::format("--patches {}", p.count));
  }
  if (run.options.gave("--cluster") && p.cluster != run.options.cluster)
    throw Error("{}: these factors are for --cluster {}; leave --cluster out", run.options.factors, p.cluster);
  run.options.patches = run.report.options.patches = p.count;
  run.options.patchSize = run.report.options.patchSize = p.size;
  run.options.cluster = run.report.options.cluster = p.cluster;
  run.spec = parseMethod(run.kept->about().method);
  run.spec->seed = run.kept->about().seed;
  run.report.why = fmt::format("kept in {}", run.options.factors);
}

void cut(RunState& run) {
  run.facets = buildFacets(run.scene, run.log);
  run.patches = buildPatches(run.scene, run.facets, patchOptionsOf(run.options));
  if (run.kept) run.kept->requireSame(fingerprintOf(run.facets, run.patches), run.options.scene);
  run.report.facets = run.facets.facets.size();
  run.report.degenerate = run.facets.degenerate;
  run.report.duplicate = run.facets.duplicate;
  run.report.welded = run.facets.welded;
  const bool byCount = run.options.tolerance == 0 && run.options.patchSize == 0;
  if (byCount && run.options.cluster == 0 && run.facets.facets.size() > run.options.patches / 2) {
    run.log.note(
        fmt::format("{} facets need at least a patch each: {} patches instead of about {}; --cluster 15 gathers small ones",
                    run.facets.facets.size(), run.patches.frontPatchCount, run.options.patches));
  }
  constexpr size_t kMany = 3;
  if (byCount && run.options.cluster > 0 && 2 * run.patches.frontPatchCount > kMany * run.options.patches) {
    run.log.note(fmt::format("many facets turn too much or stand apart: {} patches instead of about {}",
                             run.patches.frontPatchCount, run.options.patches));
  }
  run.countPatches();
  warnOfOverlaps(run.scene, run.facets, run.report.area, run.log);
  run.report.clock.finish("patches");
  run.say("{}: {} surfaces, {} triangles, {} facets, {} patches", run.options.scene, run.report.surfaces, run.report.triangles,
          run.report.facets, run.patches.frontPatchCount);
}

void chooseMethod(RunState& run) {
  const MethodChoice choice = farol::chooseMethod(run.situation);
  run.spec = choice.spec;
  run.report.why = choice.why;
}

void chooseSolvePlace(RunState& run) {
  const PlaceChoice choice = farol::chooseSolvePlace(run.situation, *run.f);
  if (choice.onDevice) run.solveDevice = &run.methods.device();
  run.report.solveOn = choice.onDevice ? run.methods.device().info().name : "CPU";
  run.report.solveOnWhy = choice.why;
}

}  // namespace farol
