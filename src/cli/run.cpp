#include "cli/run.h"

#include "base/error.h"
#include "base/output_file.h"
#include "chart/chart.h"
#include "cli/chart_run.h"
#include "cli/compare_run.h"
#include "cli/comparison_text.h"
#include "cli/factor_stage.h"
#include "cli/forecast.h"
#include "cli/light_stage.h"
#include "cli/results.h"
#include "cli/tolerance_run.h"
#include "cli/variants_run.h"

#include <cstdlib>
#include <tbb/global_control.h>
#include <thread>

namespace farol {
namespace {

bool needsFormFactors(RunState& run) {
  if (!run.variants.empty()) return true;
  if (!run.lit()) run.log.warn({"no-light", fmt::format("{}: nothing emits light, so the result is black", run.options.scene)});
  return run.lit() && !run.options.localIllumination;
}

bool isSolver(const std::string& text) { return text == "gpu" || text == "cpu"; }

// The same rows and lamps solved on the CPU and on the device.
void compareSolvers(RunState& run) {
  if (!isSolver(run.options.methodA) || !isSolver(run.options.methodB))
    throw UsageError("compare {} {}: gpu and cpu are compared with each other only", run.options.methodA, run.options.methodB);
  if (!run.lit()) throw Error("{}: nothing emits light: there is nothing to solve", run.options.scene);
  chooseMethod(run);
  makeFactors(run);
  SolverComparison c;
  c.a = run.options.methodA;
  c.b = run.options.methodB;
  std::array<Solution, 2> solutions;
  for (const size_t side : {size_t{0}, size_t{1}}) {
    const bool onDevice = (side == 0 ? c.a : c.b) == "gpu";
    Replicates none;
    const gpu::Device* device = onDevice ? &run.methods.device() : nullptr;
    const Stopwatch watch;
    solutions[side] = run.lightings.make(run.scene, run.patches, run.options.sky, *run.f, *run.spec, none, device).solution;
    if (!solutions[side].deviceFailure.empty()) throw Error(solutions[side].deviceFailure);
    c.sides[side] = {onDevice ? device->info().name : "CPU", watch.seconds(), solutions[side].sweeps, solutions[side].error};
  }
  addDifference(solutions[0], solutions[1], run.patches, c);
  run.report.solverComparison = c;
  run.report.clock.finish("compare");
  for (const SolverComparison::Side& side : c.sides)
    run.say("{:<32} {:.3g} s, {} sweeps, error of B {:.2g} of its mean", side.device, side.seconds, side.sweeps, side.error);
  run.say("difference of B: {:.3g} of a patch's own B at most, {:.3g} of the mean (rms)", c.largest, c.rms);
}

void compare(RunState& run) {
  if (isSolver(run.options.methodA) || isSolver(run.options.methodB)) return compareSolvers(run);
  CompareRun comparing(run.situation, run.patches, run.lightings, run.log, run.report.clock);
  run.report.comparison = comparing.compare();
  run.spec = comparing.spec();
  run.say("{}", comparisonText(*run.report.comparison, run.scene, run.patches));
  if (!run.options.output.empty()) drawDifference(run, run.report.comparison->comparison);
}

int finish(RunState& run) {
  if (run.spec) run.report.method = *run.spec;
  if (run.methods.tracerOpen()) run.report.embree = run.methods.tracer().description();
  if (const size_t messages = run.methods.validationMessages(); messages > 0)
    throw Error("the Vulkan validation layer gave {} messages", messages);
  run.report.warnings = run.log.warnings();
  if (!run.options.report.empty()) {
    writeReport(run.options.report, run.report);
    run.say("report: {}", run.options.report);
  }
  const bool missed = run.report.tolerance && !run.report.tolerance->met;
  return missed || (run.report.solution && !run.report.solution->converged) ? 3 : 0;
}

// Error against time. What a signal leaves is written all the same.
int chart(RunState& run) {
  const double before = run.report.clock.totalSeconds();
  requireWritable(besideChart(run.options.output, ".csv"));
  ChartRun made = runChart(run.options, run.scene, run.facets, besideChart(run.options.output, ".reference.csv"), run.log);
  made.chart.otherSeconds = before;
  run.report.clock.finish("chart");
  if (made.interrupted != 0 && made.chart.points.empty()) throw Interrupted(made.interrupted);
  writeChart(run.options.output, made.chart);
  run.report.clock.finish("write");
  run.say("{}chart: {}", chartText(made.chart), run.options.output);
  if (made.interrupted != 0) throw Interrupted(made.interrupted);
  return finish(run);
}

// The stages of a command in order.
int execute(RunState& run) {
  for (const std::string& path : {run.options.output, run.options.patchesCsv, run.options.report, run.options.sensorsOut}) {
    if (!path.empty()) requireWritable(path);
  }
  if (!run.options.sensors.empty()) run.sensors = loadSensors(run.options.sensors);
  if (!run.options.factors.empty()) openKept(run);
  load(run);
  cut(run);
  switch (run.options.command) {
    case Command::info:
      chooseMethod(run);
      if (run.options.tolerance > 0 && run.lit()) choosePlan(run);
      forecast(run);
      break;
    case Command::compare:
      compare(run);
      break;
    case Command::chart:
      return chart(run);
    case Command::factors:
      chooseMethod(run);
      if (run.options.tolerance > 0) {
        if (!run.lit())
          throw Error("{}: nothing emits light: an error of irradiance has no meaning; leave --tolerance out", run.options.scene);
        // A kept F is solved with lamps apart, as a scene is; a table or an export shall do for all light.
        run.options.emittersApart = run.options.output.ends_with(".npz");
        meetTolerance(run);
      } else {
        makeFactors(run);
      }
      writeFactors(run);
      if (run.plan && run.options.emittersApart)
        run.say("to solve at this tolerance: farol solve {} --factors {} --shadow-rays {} --residual {}", run.options.scene,
                run.options.output, run.options.shadowRays, run.options.residual);
      break;
    default:
      if (needsFormFactors(run)) {
        if (run.kept) {
          loadFactors(run);
        } else {
          chooseMethod(run);
          if (run.options.adapt > 0) adapt(run);
          if (run.options.tolerance > 0)
            meetTolerance(run);
          else
            makeFactors(run);
        }
        if (!run.f || run.lighting.solution.radiosity.empty()) chooseSolvePlace(run);
      }
      if (run.variants.empty()) {
        if (run.lighting.solution.radiosity.empty()) light(run);
        sayLight(run);
        writeResults(run);
      } else {
        solveVariants(run);
      }
  }
  return finish(run);
}

int printDevices() {
  try {
    for (const gpu::DeviceInfo& d : gpu::listDevices()) {
      fmt::print("{}: {} ({}), Vulkan {}, {}, {:.1f} GiB, layered drawing: {}{}\n", d.index, d.name, d.type, d.apiVersion, d.driver,
                 static_cast<double>(d.memoryBytes) / (1 << 30), d.layeredDrawing ? "yes" : "no",
                 d.refusal.empty() ? "" : fmt::format(" - cannot be used: {}", d.refusal));
    }
  } catch (const Error& e) {
    fmt::print("{}\n", e.what());
  }
  fmt::print("{}\n", Tracer::versionText());
  std::string features;
  for (const std::string& f : cpuFeatures()) features += " " + f;
  fmt::print("CPU: {} threads,{}\n", std::thread::hardware_concurrency(), features);
  return 0;
}

}  // namespace

int run(const Options& options) {
  if (options.command == Command::devices) return printDevices();
  std::optional<tbb::global_control> limit;
  if (options.threads > 0) {
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<size_t>(options.threads));
  }
  // Mesa's software device would take all cores for itself: each of a team gets its share. Other drivers ignore this.
  const bool alone = options.solveOn == "gpu" || options.methodA == "gpu" || options.methodB == "gpu";
  const size_t devices = alone ? 1 : mostSoftwareDevices(options);
  setenv("LP_NUM_THREADS", std::to_string(std::max<size_t>(1, coresFor(options) / devices)).c_str(), 0);
  RunState state(options);
  return execute(state);
}

}  // namespace farol
