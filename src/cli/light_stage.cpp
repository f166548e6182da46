#include "cli/light_stage.h"

#include "cli/warnings.h"

namespace farol {

void light(RunState& run) {
  if (run.f) {
    run.lighting = run.lightings.make(run.scene, run.patches, run.options.sky, *run.f, *run.spec, run.replicates, run.solveDevice);
    leaveFailedDevice(run, run.lighting.solution);
    run.report.lamps = run.lighting.plan.lamps.size();
    run.report.emitters = run.lighting.plan.emitters;
    run.report.lampsWhy = run.lighting.plan.why;
    run.report.shadowRays = run.lighting.direct.rays;
    warnOfSlowLight(run.lighting.solution, run.log);
  } else {
    run.lighting = run.lightings.local(run.scene, run.patches);
  }
  reportSolution(run);
  if (run.f) warnOfDrift(*run.report.energy, *run.report.solution, run.log);
  run.report.clock.finish("solve");
}

void leaveFailedDevice(RunState& run, const Solution& solution) {
  if (solution.deviceFailure.empty() || run.solveDevice == nullptr) return;
  run.log.warn({"device-failed", fmt::format("{}; the CPU solves instead", solution.deviceFailure)});
  run.solveDevice = nullptr;
  run.report.solveOn = "CPU";
  run.report.solveOnWhy = "the device failed";
}

void reportSolution(RunState& run) {
  run.report.solution = run.lighting.solution;
  run.report.solution->radiosity.clear();
  run.report.solution->irradiance.clear();
  if (!run.f) return;
  run.report.energy = energyBalance(*run.f, run.patches, run.lighting.solution, run.options.sky, run.lighting.fromPunctual);
  run.report.estimatedError = relativeError(*run.f, run.patches, run.lighting);
}

void sayLight(const RunState& run) {
  if (!run.f) {
    run.say("{}", run.options.localIllumination && run.lit()
                      ? "local illumination: emitters as points, nothing in between, no interreflection"
                      : "nothing to solve: black");
    return;
  }
  if (run.report.emittingPatches > 0) run.say("emitters: {}", run.lighting.plan.why);
  run.say("light: {} of {} lamps apart, {} punctual lights, {} shadow rays; error of H {:.2g} of its mean (rms, estimated)",
          run.report.lamps, run.report.emitters, run.scene.lights.size(), run.report.shadowRays, *run.report.estimatedError);
  const Solution& s = run.lighting.solution;
  run.say("solve: {} on {} ({}): {} sweeps, residual {:.3g}, contraction {:.4f}, error of B {:.2g} of its mean: {}",
          run.solveDevice != nullptr ? "jacobi" : solverName(s.kind), run.report.solveOn, run.report.solveOnWhy, s.sweeps,
          s.residual, s.contraction, s.error, s.converged ? "converged" : "NOT converged");
  const EnergyBalance& e = *run.report.energy;
  const double in = luminance(e.emitted + e.fromSky + e.fromPunctual);
  run.say("energy: {:.4g} in, {:.4g} absorbed, {:.4g} to the open, {:.4g} to backs (balance within {:.2g} %)", in,
          luminance(e.absorbed), luminance(e.toOpen), luminance(e.toBacks), 100 * e.relativeError);
}

}  // namespace farol
