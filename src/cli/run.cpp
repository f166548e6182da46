#include "cli/run.h"

#include "base/error.h"
#include "base/output_file.h"
#include "chart/chart.h"
#include "cli/adapting.h"
#include "cli/chart_run.h"
#include "cli/choices.h"
#include "cli/compare_run.h"
#include "cli/comparison_text.h"
#include "cli/report.h"
#include "cli/tolerance.h"
#include "cli/variants.h"
#include "cli/warnings.h"
#include "formfactor/error_model.h"
#include "formfactor/near_field.h"
#include "formfactor/repair.h"
#include "output/factor_archive.h"
#include "output/output.h"
#include "output/sensor_files.h"
#include "view/tone.h"
#include "view/view.h"

#include <cstdlib>
#include <map>
#include <numeric>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <thread>

namespace farol {
namespace {


// One run of render, solve, factors, compare or info: the stages in order, each leaving its result in a member.
class Run {
 public:
  explicit Run(const Options& options)
      : options_(options),
        log_(options.quiet),
        methods_(options_, scene_, facets_, patches_, log_),
        situation_{options_, scene_, facets_, patches_, methods_},
        lightings_(options_, facets_, methods_, log_) {
    report_.options = options;
  }

  int execute() {
    for (const std::string& path : {options_.output, options_.patchesCsv, options_.report, options_.sensorsOut}) {
      if (!path.empty()) requireWritable(path);
    }
    if (!options_.sensors.empty()) sensors_ = loadSensors(options_.sensors);
    if (!options_.factors.empty()) openKept();
    load();
    cut();
    switch (options_.command) {
      case Command::info:
        chooseMethod();
        if (options_.tolerance > 0 && lit()) choosePlan();
        forecast();
        break;
      case Command::compare:
        compare();
        break;
      case Command::chart:
        return chart();
      case Command::factors:
        chooseMethod();
        if (options_.tolerance > 0) {
          if (!lit()) throw Error("{}: nothing emits light: an error of irradiance has no meaning; leave --tolerance out", options_.scene);
          options_.emittersApart = false;
          meetTolerance();
        } else {
          makeF();
        }
        writeFactors();
        break;
      default:
        if (needsFormFactors()) {
          if (kept_) {
            loadF();
          } else {
            chooseMethod();
            if (options_.adapt > 0) adapt();
            if (options_.tolerance > 0)
              meetTolerance();
            else
              makeF();
          }
          if (!f_ || lighting_.solution.radiosity.empty()) chooseSolvePlace();
        }
        if (variants_.empty()) {
          if (lighting_.solution.radiosity.empty()) light();
          sayLight();
          writeResults();
        } else {
          solveVariants();
        }
    }
    return finish();
  }

 private:
  void load() {
    scene_ = loadScene(options_.scene, log_);
    report_.surfaces = scene_.surfaces.size();
    for (const Surface& s : scene_.surfaces) report_.triangles += s.triangles.size();
    if (options_.command == Command::render || (options_.command == Command::compare && !options_.output.empty()))
      camera_ = chooseCamera(scene_, options_.camera);
    if (!options_.variants.empty()) variants_ = loadVariants(options_.variants, scene_);
    report_.clock.finish("load");
  }

  // The file of factors also says which patches they are for.
  void openKept() {
    kept_.emplace(options_.factors);
    const PatchOptions& p = kept_->about().patches;
    if ((options_.gave("--patches") || options_.gave("--patch-size")) && (p.size != options_.patchSize || (p.size == 0 && p.count != options_.patches))) {
      throw Error("{}: these factors are for {}; leave --patches and --patch-size out", options_.factors,
                  p.size > 0 ? fmt::format("--patch-size {}", p.size) : fmt::format("--patches {}", p.count));
    }
    if (options_.gave("--cluster") && p.cluster != options_.cluster)
      throw Error("{}: these factors are for --cluster {}; leave --cluster out", options_.factors, p.cluster);
    options_.patches = report_.options.patches = p.count;
    options_.patchSize = report_.options.patchSize = p.size;
    options_.cluster = report_.options.cluster = p.cluster;
    spec_ = parseMethod(kept_->about().method);
    spec_->seed = kept_->about().seed;
    report_.why = fmt::format("kept in {}", options_.factors);
  }

  void cut() {
    facets_ = buildFacets(scene_, log_);
    patches_ = buildPatches(scene_, facets_, patchOptionsOf(options_));
    if (kept_) kept_->requireSame(fingerprintOf(facets_, patches_), options_.scene);
    report_.facets = facets_.facets.size();
    report_.degenerate = facets_.degenerate;
    report_.duplicate = facets_.duplicate;
    report_.welded = facets_.welded;
    if (options_.patchSize == 0 && options_.cluster == 0 && facets_.facets.size() > options_.patches / 2) {
      log_.note(fmt::format("{} facets need at least a patch each: {} patches instead of about {}; --cluster 15 gathers small ones",
                            facets_.facets.size(), patches_.frontPatchCount, options_.patches));
    }
    constexpr size_t kMany = 3;
    if (options_.patchSize == 0 && options_.cluster > 0 && 2 * patches_.frontPatchCount > kMany * options_.patches) {
      log_.note(fmt::format("many facets turn too much or stand apart: {} patches instead of about {}", patches_.frontPatchCount, options_.patches));
    }
    countPatches();
    warnOfMirroredPoints(scene_, patches_, log_);
    warnOfOverlaps(scene_, facets_, report_.area, log_);
    report_.clock.finish("patches");
    say("{}: {} surfaces, {} triangles, {} facets, {} patches", options_.scene, report_.surfaces, report_.triangles,
        report_.facets, patches_.frontPatchCount);
  }

  void countPatches() {
    report_.cells = patches_.cells.size();
    report_.patches = patches_.size();
    report_.area = 0;
    report_.specularPatches = report_.emittingPatches = 0;
    for (const Patch& p : patches_.patches) {
      report_.area += p.area;
      if (p.isSpecular()) ++report_.specularPatches;
      if (p.emits()) ++report_.emittingPatches;
    }
  }

  bool lit() const {
    return report_.emittingPatches > 0 || maxChannel(options_.sky) > 0 || !scene_.lights.empty();
  }

  bool needsFormFactors() {
    if (!variants_.empty()) return true;
    if (!lit()) log_.warn({"no-light", fmt::format("{}: nothing emits light, so the result is black", options_.scene)});
    return lit() && !options_.localIllumination;
  }

  void chooseMethod() {
    const MethodChoice choice = farol::chooseMethod(situation_);
    spec_ = choice.spec;
    report_.why = choice.why;
  }

  void chooseSolvePlace() {
    const PlaceChoice choice = farol::chooseSolvePlace(situation_, *f_);
    if (choice.onDevice) solveDevice_ = &methods_.device();
    report_.solveOn = choice.onDevice ? methods_.device().info().name : "CPU";
    report_.solveOnWhy = choice.why;
  }

  void makeF() {
    const StorageChoice storage = chooseStorage(situation_, *spec_);
    report_.storageWhy = storage.why;
    if (spec_->hemicubes()) {
      methods_.device();
      report_.clock.finish("device");
    }
    f_.emplace(patches_.size(), allowedBytes(options_), storage.storage);
    if (patches_.colouredSpecular()) f_->addChannels();
    const std::unique_ptr<RowMaker> maker = methods_.maker(*spec_);
    // A kept F, or one for many lightings, may be lit from anywhere: it has a row for every patch.
    const bool all = maxChannel(options_.sky) > 0 || options_.output.ends_with(".npz") || !variants_.empty();
    makeFormFactors(*maker, patches_, all, log_, *f_);
    countPatches();
    reportStorage();
    report_.clock.finish("form factors");
    model_ = fitErrorModel(*f_, patches_, makeProbes(methods_, patches_, *spec_, *f_, options_.tolerance > 0 ? kProbes / 3 : kProbes, options_.tolerance > 0 ? 4 : 16), samplesOf(*spec_));
    replicateRows();
    if (spec_->kind == MethodSpec::Kind::exact) model_ = {};
    if (options_.repair) repair();
    report_.errorModel = model_;
    report_.checks = checkFormFactors(*f_, patches_);
    sayModel(report_.checks->specular);
    reportRowErrors();
    warnOfBrokenRules(*report_.checks, *f_, model_, patches_, scene_, log_);
    report_.clock.finish("checks");
    if (methods_.deviceOpen()) {
      report_.device = methods_.device().info();
      report_.devices = methods_.softwareDevices;
      report_.batch = methods_.batch;
      report_.deviceBytes = methods_.deviceBytes;
    }
    const double seconds = report_.clock.secondsOf("form factors");
    say("form factors: {}: {} rows in {:.2f} s ({:.0f} rows/s), row sums {:.6f} to {:.6f}, {:.3g} % missed the scene, "
        "{:.3g} % met backs; row error {:.2g} (mean L1, estimated)",
        methodText(*spec_), patches_.size(), seconds, static_cast<double>(patches_.size()) / seconds,
        report_.checks->rowSumMin, report_.checks->rowSumMax, 100 * report_.checks->missed,
        100 * report_.checks->backs, report_.rowErrorMean);
    if (f_->packedRows() > 0) {
      say("storage: {} of {} rows in 16 bits ({}), L1 error of a row at most {:.2g} by it", f_->packedRows(), f_->size(),
          storage.why, f_->packingError());
    }
  }

  // What is known of errors stays that of the rows as they were made.
  void repair() {
    report_.repair = repairRows(*f_, patches_);
    reportStorage();
    const Repair& r = *report_.repair;
    say("repair: {} sweeps; entries and their mirror images differed by {:.2g} % in all, rows changed by {:.2g} (mean L1), {:.2g} at most; sums within {:.1g}", r.sweeps,
        100 * r.asymmetry, r.meanChange, r.largestChange, r.closure);
  }

  void reportStorage() {
    report_.matrixBytes = f_->bytes();
    report_.coloured = f_->coloured();
    report_.denseRows = f_->denseRows();
    report_.packedRows = f_->packedRows();
    report_.packingError = f_->packingError();
  }

  // F as it was kept. How good its rows are was told when they were made.
  void loadF() {
    f_.emplace(kept_->load(patches_.size(), allowedBytes(options_)));
    report_.storageWhy = "as kept";
    reportStorage();
    if (auto again = kept_->replicates(patches_.size())) {
      replicates_.patches = std::move(again->patches);
      replicates_.rows = std::move(again->rows);
      replicates_.better = spec_->hemicubes();
    }
    report_.clock.finish("form factors");
    if (!replicates_.rows) replicateRows();
    report_.checks = checkFormFactors(*f_, patches_);
    report_.clock.finish("checks");
    say("form factors: {} rows of {} in {:.2f} s from {}", f_->size(), kept_->about().method,
        report_.clock.secondsOf("form factors"), options_.factors);
  }

  // Their differences to F's rows tell the error of H.
  void replicateRows() {
    constexpr size_t kFewest = 384, kShare = 16;
    replicates_ = replicatesOf(methods_, patches_, *spec_, *f_, std::max(spec_->hemicubes() ? kFewest / 2 : kFewest, patches_.size() / kShare));
  }

  void reportRowErrors() {
    double area = 0;
    for (const uint32_t i : chooseProbes(patches_, 256)) {
      const double a = patches_.patches[i].area * f_->shares(i).exposed, error = model_.rowError(i);
      report_.rowErrorMean += a * error;
      report_.rowErrorMax = std::max(report_.rowErrorMax, error);
      area += a;
    }
    if (area > 0) report_.rowErrorMean /= area;
  }

  void adapt() {
    const Adapting a = adaptTo(options_, scene_, facets_, *spec_);
    options_.patchSize = report_.options.patchSize = a.size.size;
    takeAdapted(a);
    report_.clock.finish("adapting");
    if (a.tried == 0) {
      say("patches: {} facets are too many to try smaller ones: all stay as large as --patch-size {}", facets_.facets.size(), options_.patchSize);
      return;
    }
    if (a.adapted.error > options_.adapt) {
      log_.warn({"adapt-not-met", fmt::format("the smallest patches are {} times smaller than the largest, and still constant patches are predicted to cost {:.2g} % of H: {:.2g} % was asked for",
                                              1u << PatchTree::kMostLevels, 100 * a.adapted.error, 100 * options_.adapt), {}, a.adapted.error});
    }
    say("patches: {} of {} sizes, from {} of a trial; constant patches are predicted to cost {:.2g} % of H", patches_.size(), a.adapted.tree.levels() + 1, a.tried,
        100 * a.adapted.error);
  }

  void takeAdapted(const Adapting& a) {
    patches_ = buildPatches(scene_, facets_, a.size, a.adapted.tree);
    methods_.patchesChanged();
    countPatches();
    if (a.tried > 0) report_.adapted = AdaptedReport{a.tried, a.adapted.tree.levels(), a.adapted.error};
  }

  void choosePlan() {
    plan_ = planFor(options_, scene_, facets_, *spec_);
    applyPlan();
    report_.clock.finish("choosing");
    say("tolerance {:.3g} %: {:.2g} % predicted, in {:.2g} s:", 100 * options_.tolerance, 100 * plan_->predicted.total(), plan_->seconds);
    for (const Choice& c : plan_->choices) say("  {}: {} ({})", c.what, c.value, c.why);
  }

  // The options and patches of the plan. With --patches given the patches stay as they are.
  void applyPlan() {
    applyOptions();
    if (plan_->adapt > 0) {
      if (!plan_->adapted) plan_->adapted = adaptTo(options_, scene_, facets_, *spec_);
      takeAdapted(*plan_->adapted);
      return;
    }
    patches_ = buildPatches(scene_, facets_, patchOptionsOf(options_));
    methods_.patchesChanged();
    countPatches();
  }

  void applyOptions() {
    options_.patchSize = plan_->size.size;
    if (plan_->size.size == 0) options_.patches = plan_->size.count;
    options_.shadowRays = plan_->setting.shadowRays;
    options_.residual = plan_->setting.residual;
    spec_ = plan_->setting.spec;
    options_.rays = spec_->rays;
    options_.resolution = spec_->resolution;
    options_.positions = spec_->positions;
    options_.adapt = plan_->adapt;
    report_.options = options_;
  }

  // False, with all as it was, where memory does not hold F as the plan asks for it.
  bool applyRefined(const TolerancePlan& next) {
    const TolerancePlan plan = *plan_;
    const auto adapted = report_.adapted;
    PatchSet patches = patches_;
    plan_ = next;
    try {
      applyPlan();
      chooseStorage(situation_, *spec_);
      return true;
    } catch (const Error&) {
      plan_ = plan;
      applyOptions();
      report_.adapted = adapted;
      patches_ = std::move(patches);
      methods_.patchesChanged();
      countPatches();
      return false;
    }
  }

  // Chooses, solves, and refines where the estimate of what was reached says so.
  void meetTolerance() {
    constexpr int kRounds = 4;
    const Stopwatch watch;
    choosePlan();
    ErrorParts found;
    for (int round = 0;; ++round) {
      makeF();
      if (round == 0) chooseSolvePlace();
      light();
      found = errorParts();
      report_.estimatedError = found.total();
      report_.clock.finish("errors");
      if (found.total() <= options_.tolerance || round + 1 == kRounds || !plan_->limitedBy.empty()) break;
      const TolerancePlan next = refined(*plan_, options_, facets_, found);
      const bool changed = next.size.size != plan_->size.size || next.adapt != plan_->adapt || next.setting.spec.rays != plan_->setting.spec.rays ||
                           next.setting.spec.resolution != plan_->setting.spec.resolution || next.setting.spec.positions != plan_->setting.spec.positions ||
                           next.setting.shadowRays != plan_->setting.shadowRays;
      if (!changed) {
        plan_->limitedBy = "the options given";
        break;
      }
      if (options_.time > 0 && 2 * watch.seconds() > options_.time) {
        plan_->limitedBy = "time";
        break;
      }
      say("refined: the error is estimated as {:.2g} % (patches {:.2g}, rows {:.2g}, light {:.2g})", 100 * found.total(), 100 * found.patches, 100 * found.rows,
          100 * found.light);
      if (!applyRefined(next)) {
        plan_->limitedBy = "memory";
        break;
      }
      report_.checks.reset();
      replicates_ = {};
      lighting_ = {};
    }
    report_.tolerance = ToleranceReport{options_.tolerance, found.total() <= options_.tolerance, *plan_, found, watch.seconds()};
    if (!report_.tolerance->met) {
      log_.warn({"tolerance-not-met", fmt::format("the tolerance of {:.3g} % is not met: the error of H is estimated as {:.2g} %{}", 100 * options_.tolerance,
                                                  100 * found.total(), plan_->limitedBy.empty() ? "" : "; limited by " + plan_->limitedBy),
                 {}, found.total()});
    }
  }

  ErrorParts errorParts() {
    ErrorParts e;
    e.patches = plan_->adapted ? adaptedPatchErrorOf(*f_, patches_, facets_, lighting_, *plan_->adapted) : patchErrorOf(*f_, patches_, facets_, lighting_).error;
    Replicates none;
    none.patches = replicates_.patches;
    const auto by = [&](const DirectLight& direct) {
      const std::vector<Rgb> kept = lighting_.error;
      lighting_.error = irradianceError(*f_, patches_, direct, lighting_.solution, none, samplesOf(*spec_), options_.sky);
      const double error = relativeError(*f_, patches_, lighting_);
      lighting_.error = kept;
      return error;
    };
    DirectLight exact = lighting_.direct;
    exact.deviation.clear();
    e.sweeps = by(exact);
    const double lightAndSweeps = by(lighting_.direct), all = *report_.estimatedError;
    e.light = std::sqrt(std::max(0.0, lightAndSweeps * lightAndSweeps - e.sweeps * e.sweeps));
    e.rows = std::sqrt(std::max(0.0, all * all - lightAndSweeps * lightAndSweeps));
    return e;
  }

  // What a device that failed has left is solved on the CPU, and so is all that follows.
  void leaveFailedDevice(const Solution& solution) {
    if (solution.deviceFailure.empty() || solveDevice_ == nullptr) return;
    log_.warn({"device-failed", fmt::format("{}; the CPU solves instead", solution.deviceFailure)});
    solveDevice_ = nullptr;
    report_.solveOn = "CPU";
    report_.solveOnWhy = "the device failed";
  }

  // Light the scene as it stands.
  void light() {
    if (f_) {
      lighting_ = lightings_.make(scene_, patches_, options_.sky, *f_, *spec_, replicates_, solveDevice_);
      leaveFailedDevice(lighting_.solution);
      report_.lamps = lighting_.plan.lamps.size();
      report_.emitters = lighting_.plan.emitters;
      report_.lampsWhy = lighting_.plan.why;
      report_.shadowRays = lighting_.direct.rays;
      warnOfSlowLight(lighting_.solution, log_);
    } else {
      lighting_ = lightings_.local(scene_, patches_);
    }
    reportSolution();
    if (f_) warnOfDrift(*report_.energy, *report_.solution, log_);
    report_.clock.finish("solve");
  }

  void sayLight() {
    if (!f_) {
      say("{}", options_.localIllumination && lit()
                    ? "local illumination: emitters as points, nothing in between, no interreflection"
                    : "nothing to solve: black");
      return;
    }
    if (report_.emittingPatches > 0) say("emitters: {}", lighting_.plan.why);
    say("light: {} of {} lamps apart, {} punctual lights, {} shadow rays; error of H {:.2g} of its mean (rms, estimated)",
        report_.lamps, report_.emitters, scene_.lights.size(), report_.shadowRays, *report_.estimatedError);
    const Solution& s = lighting_.solution;
    say("solve: {} on {} ({}): {} sweeps, residual {:.3g}, contraction {:.4f}, error of B {:.2g} of its mean: {}",
        solveDevice_ != nullptr ? "jacobi" : solverName(s.kind), report_.solveOn, report_.solveOnWhy, s.sweeps,
        s.residual, s.contraction, s.error, s.converged ? "converged" : "NOT converged");
    const EnergyBalance& e = *report_.energy;
    const double in = luminance(e.emitted + e.fromSky + e.fromPunctual);
    say("energy: {:.4g} in, {:.4g} absorbed, {:.4g} to the open, {:.4g} to backs (balance within {:.2g} %)", in,
        luminance(e.absorbed), luminance(e.toOpen), luminance(e.toBacks), 100 * e.relativeError);
  }

  // Of the lighting at hand.
  void reportSolution() {
    report_.solution = lighting_.solution;
    report_.solution->radiosity.clear();
    report_.solution->irradiance.clear();
    if (!f_) return;
    report_.energy = energyBalance(*f_, patches_, lighting_.solution, options_.sky, lighting_.fromPunctual);
    report_.estimatedError = relativeError(*f_, patches_, lighting_);
  }

  // The scene as the variant has it; patches keep their places.
  void change(const Scene& base, const Variant& variant) {
    scene_ = changed(base, variant);
    patches_ = buildPatches(scene_, facets_, patchOptionsOf(options_));
  }

  void solveVariants() {
    const Scene base = scene_;
    const Options options = options_;
    std::vector<UnitLighting> units = unitLightings(base, variants_);
    const auto alike = static_cast<size_t>(std::count_if(variants_.begin(), variants_.end(), [](const Variant& v) { return v.emissionOnly(); }));
    if (units.size() >= alike) units.clear();  // not worth it
    std::vector<Lighting> made;
    for (const UnitLighting& unit : units) {
      const PatchSet patches = buildPatches(unit.scene, facets_, patchOptionsOf(options_));
      made.push_back(lightings_.make(unit.scene, patches, unit.material ? Rgb(0) : options_.sky, *f_, *spec_, replicates_, solveDevice_));
      leaveFailedDevice(made.back().solution);
    }
    report_.clock.finish("unit solutions");
    bool converged = true;
    for (const Variant& variant : variants_) {
      change(base, variant);
      lighting_ = {};
      const bool combined = variant.emissionOnly() && !units.empty();
      if (combined) {
        for (size_t k = 0; k < units.size(); ++k) {
          const Rgb factor = factorOf(units[k], variant, base);
          if (maxChannel(factor) > 0) add(lighting_, made[k], factor);
        }
        if (lighting_.solution.irradiance.empty()) add(lighting_, made.back(), Rgb(0));
      } else {
        lighting_ = lightings_.make(scene_, patches_, options_.sky, *f_, *spec_, replicates_, solveDevice_);
        leaveFailedDevice(lighting_.solution);
      }
      reportSolution();
      converged &= lighting_.solution.converged;
      report_.variants.push_back({variant.name, combined ? units.size() : 0, lighting_.solution.sweeps,
                                  lighting_.solution.converged, *report_.estimatedError, report_.energy->relativeError,
                                  luminance(report_.energy->emitted + report_.energy->fromSky + report_.energy->fromPunctual)});
      report_.clock.finish("variants");
      for (std::string Options::*path : {&Options::output, &Options::patchesCsv, &Options::sensorsOut})
        options_.*path = variantPath(options.*path, variant);
      const bool quiet = options_.quiet;
      options_.quiet = true;  // one line per variant is enough
      writeResults();
      options_.quiet = quiet;
      say("variant '{}': {}, error of H {:.2g} of its mean (estimated), energy within {:.2g} %", variant.name,
          combined ? fmt::format("from {} unit solutions", units.size())
                   : fmt::format("solved in {} sweeps", lighting_.solution.sweeps),
          *report_.estimatedError, 100 * report_.energy->relativeError);
    }
    options_ = options;
    report_.solution->converged = converged;
  }

  void writeResults() {
    readSensorsHere();
    if (options_.command == Command::render)
      draw();
    else
      writeSolved();
  }

  void readSensorsHere() {
    if (sensors_.empty()) return;
    if (!f_) throw Error("{}: sensors need a global solution of a scene with light", options_.scene);
    SensorOptions o;
    o.seed = options_.seed;
    o.sky = options_.sky;
    const RayTree tree(methods_.tracer(), facets_, patches_, methods_.limits());
    const auto readings =
        readSensors(tree, methods_.tracer(), facets_, patches_, lightings_.lamps(lighting_.plan, scene_, patches_, options_.seed),
                    lighting_.direct, lighting_.solution, sensors_, o);
    writeSensorReadings(options_.sensorsOut, sensors_, readings);
    double low = 1e300, high = 0, mean = 0;
    for (const SensorReading& r : readings) {
      low = std::min(low, luminance(r.irradiance));
      high = std::max(high, luminance(r.irradiance));
      mean += luminance(r.irradiance) / static_cast<double>(readings.size());
    }
    report_.sensors = readings.size();
    report_.clock.finish("sensors");
    say("sensors: {} readings in {}: {:.4g} to {:.4g}, mean {:.4g} (luminance)", readings.size(), options_.sensorsOut,
        low, high, mean);
  }

  static bool isSolver(const std::string& text) { return text == "gpu" || text == "cpu"; }

  // The same rows and lamps solved on the CPU and on the device.
  void compareSolvers() {
    if (!isSolver(options_.methodA) || !isSolver(options_.methodB))
      throw UsageError("compare {} {}: gpu and cpu are compared with each other only", options_.methodA, options_.methodB);
    if (!lit()) throw Error("{}: nothing emits light: there is nothing to solve", options_.scene);
    chooseMethod();
    makeF();
    SolverComparison c;
    c.a = options_.methodA;
    c.b = options_.methodB;
    std::array<Solution, 2> solutions;
    for (const size_t side : {size_t{0}, size_t{1}}) {
      const bool onDevice = (side == 0 ? c.a : c.b) == "gpu";
      Replicates none;
      const gpu::Device* device = onDevice ? &methods_.device() : nullptr;
      const Stopwatch watch;
      solutions[side] = lightings_.make(scene_, patches_, options_.sky, *f_, *spec_, none, device).solution;
      if (!solutions[side].deviceFailure.empty()) throw Error(solutions[side].deviceFailure);
      c.sides[side] = {onDevice ? device->info().name : "CPU", watch.seconds(), solutions[side].sweeps, solutions[side].error};
    }
    addDifference(solutions[0], solutions[1], patches_, c);
    report_.solverComparison = c;
    report_.clock.finish("compare");
    for (const SolverComparison::Side& side : c.sides)
      say("{:<32} {:.3g} s, {} sweeps, error of B {:.2g} of its mean", side.device, side.seconds, side.sweeps, side.error);
    say("difference of B: {:.3g} of a patch's own B at most, {:.3g} of the mean (rms)", c.largest, c.rms);
  }

  void compare() {
    if (isSolver(options_.methodA) || isSolver(options_.methodB)) return compareSolvers();
    CompareRun run(situation_, patches_, lightings_, log_, report_.clock);
    report_.comparison = run.compare();
    spec_ = run.spec();
    say("{}", comparisonText(*report_.comparison, scene_, patches_));
    if (!options_.output.empty()) drawDifference(report_.comparison->comparison);
  }

  void drawDifference(const Comparison& c) {
    const std::vector<Rgb> colors = differenceColors(c);
    lighting_.solution.irradiance.assign(patches_.size(), Rgb(0));
    ViewOptions o;
    o.width = options_.width;
    o.height = options_.height;
    o.patches = &patches_;
    o.colors = &colors;
    const Image image = renderView(methods_.device(), scene_, facets_, nodes(), camera_, o, log_);
    writePng(options_.output, image.width, image.height, toSrgb(image, 1.0));
    report_.clock.finish("view");
    say("picture: {} (yellow: L1 {:.3g}; dark blue: 0)", options_.output, c.l1Max);
  }

  NodeIrradiance nodes() const {
    return NodeIrradiance(scene_, facets_, patches_, f_ ? &*f_ : nullptr, lighting_.solution.irradiance);
  }

  void draw() {
    const gpu::Device& device = methods_.device();
    report_.device = device.info();
    report_.clock.finish("device");
    const NodeIrradiance irradiance = nodes();
    ViewOptions o;
    o.width = options_.width;
    o.height = options_.height;
    o.sky = options_.sky;
    std::optional<RayTree> tree;
    if (patches_.anySpecular()) {
      tree.emplace(methods_.tracer(), facets_, patches_, methods_.limits());
      o.tree = &*tree;
      o.patches = &patches_;
    }
    const Image image = renderView(device, scene_, facets_, irradiance, camera_, o, log_);
    report_.clock.finish("view");
    const double stops = std::exp2(options_.exposure);
    if (options_.output.ends_with(".exr")) {
      report_.displayScale = stops;
      writeExr(options_.output, image, stops);
    } else {
      report_.displayScale = stops * automaticScale(image);
      writePng(options_.output, image.width, image.height, toSrgb(image, *report_.displayScale));
    }
    writePatches();
    report_.clock.finish("write");
    say("picture: {} ({} x {}, camera '{}', radiance x {:.4g})", options_.output, image.width, image.height,
        camera_.name, *report_.displayScale);
  }

  void writeSolved() {
    if (!options_.output.empty()) {
      writeLitGlb(options_.output, scene_, facets_, patches_, nodes(), options_.exposure);
      say("lit scene: {}", options_.output);
    }
    writePatches();
    report_.clock.finish("write");
  }

  void writePatches() const {
    if (options_.patchesCsv.empty()) return;
    writePatchesCsv(options_.patchesCsv, scene_, patches_, f_ ? &*f_ : nullptr, lighting_.solution, lighting_.error);
    say("patches: {}", options_.patchesCsv);
  }

  void writeFactors() {
    if (!options_.output.empty()) {
      if (options_.by == "surface")
        writeFactorsBySurface(options_.output, scene_, patches_, *f_);
      else if (options_.output.ends_with(".npz"))
        writeFactorsNpz(options_.output, *f_, patches_,
                        {methodText(*spec_), spec_->seed, patchOptionsOf(options_),
                         fingerprintOf(facets_, patches_)},
                        replicates_.patches, replicates_.rows ? &*replicates_.rows : nullptr);
      else if (options_.output.ends_with(".npy"))
        writeFactorsNpy(options_.output, *f_);
      else
        writeFactorsMtx(options_.output, *f_);
      say("factors: {}", options_.output);
    }
    report_.clock.finish("write");
  }

  // Share of what patches see that is a mirror or glass: some rows by rays.
  double seenFirstAsSpecular() {
    if (!patches_.anySpecular()) return 0;
    MethodSpec few = specFrom(options_, MethodSpec::Kind::rays);
    few.rays = 256;
    FormFactorMatrix rows(patches_.size());
    const std::vector<uint32_t> probes = chooseProbes(patches_, 64);
    methods_.maker(few)->makeRows(probes, rows, [](size_t) {});
    double share = 0;
    for (const uint32_t i : probes) share += rows.shares(i).specular / static_cast<double>(probes.size());
    return share;
  }

  // Which parts of the model the scene asks for, and what mirrors and glass are worth.
  void sayModel(double metSpecular) {
    double passed = 0, area = 0, grey = 0;
    for (const Patch& p : patches_.patches) {
      grey = std::max(grey, maxChannel(p.reflectance + p.emission) - minChannel(p.reflectance + p.emission));
      if (!p.isSpecular()) continue;
      passed += p.area * maxChannel(p.specular());
      area += p.area;
    }
    report_.model = {grey > 0 || maxChannel(options_.sky) > minChannel(options_.sky), patches_.anySpecular(),
                     patches_.colouredSpecular(), area > 0 ? metSpecular * passed / area : 0};
    if (!patches_.anySpecular()) return;
    say("mirrors and glass: {} patches; {:.2g} % of what patches see first; left out, H would change by about {:.2g} % of its mean{}",
        report_.specularPatches, 100 * metSpecular, 100 * report_.model.withoutSpecular,
        patches_.colouredSpecular() ? "; coloured: one F per channel" : "");
  }

  // Error against time. What a signal leaves is written all the same.
  int chart() {
    const double before = report_.clock.totalSeconds();
    requireWritable(besideChart(options_.output, ".csv"));
    ChartRun run = runChart(options_, scene_, facets_, besideChart(options_.output, ".reference.csv"), log_);
    run.chart.otherSeconds = before;
    report_.clock.finish("chart");
    if (run.interrupted != 0 && run.chart.points.empty()) throw Interrupted(run.interrupted);
    writeChart(options_.output, run.chart);
    report_.clock.finish("write");
    say("{}chart: {}", chartText(run.chart), options_.output);
    if (run.interrupted != 0) throw Interrupted(run.interrupted);
    return finish();
  }

  // What a run would take: exact counts, memory of F, and seconds from half a second of probe rows.
  void forecast() {
    constexpr double kProbeSeconds = 0.5;
    say("area {:.6g} square units, {} patches emit, {} have a specular share; {} cameras, {} punctual lights, {} "
        "textures",
        report_.area, report_.emittingPatches, report_.specularPatches, scene_.cameras.size(), scene_.lights.size(),
        scene_.textures.size());
    for (const Camera& c : scene_.cameras) say("camera '{}'", c.name);
    if (facets_.welded > 0)
      say("{} vertices were moved to a neighbour within {:.3g} units", facets_.welded,
          kWeldTolerance * facets_.frame.size);
    say("method: {} ({})", methodText(*spec_), report_.why);
    const RowProbe probe = probeRows(situation_, *spec_, kProbeSeconds);
    StorageChoice storage = chooseStorage(situation_, *spec_);
    if (storage.storage == Storage::float32) storage.bytes = probe.bytesPerRow * static_cast<double>(probe.rows);
    report_.matrixBytes = static_cast<uint64_t>(storage.bytes);
    report_.storageWhy = storage.why;
    say("form factors would take {:.4g} MB; {:.4g} MB are allowed ({})", storage.bytes * 1e-6,
        static_cast<double>(allowedBytes(options_)) * 1e-6, storage.why);
    sayModel(seenFirstAsSpecular());
    const LampPlan plan = lightings_.plan(patches_, *spec_);
    report_.lamps = plan.lamps.size();
    report_.emitters = plan.emitters;
    report_.lampsWhy = plan.why;
    if (report_.emittingPatches > 0) say("emitters: {}", plan.why);
    say("form factors would take {:.3g} s ({:.0f} rows/s measured)",
        static_cast<double>(probe.rows) / probe.rowsPerSecond, probe.rowsPerSecond);
    report_.clock.finish("probe");
  }

  int finish() {
    if (spec_) report_.method = *spec_;
    if (methods_.tracerOpen()) report_.embree = methods_.tracer().description();
    if (const size_t messages = methods_.validationMessages(); messages > 0) 
      throw Error("the Vulkan validation layer gave {} messages", messages);
    report_.warnings = log_.warnings();
    if (!options_.report.empty()) {
      writeReport(options_.report, report_);
      say("report: {}", options_.report);
    }
    const bool missed = report_.tolerance && !report_.tolerance->met;
    return missed || (report_.solution && !report_.solution->converged) ? 3 : 0;
  }

  template <typename... Args>
  void say(fmt::format_string<Args...> format, Args&&... args) const {
    if (!options_.quiet) fmt::print("{}\n", fmt::format(format, std::forward<Args>(args)...));
  }

  Options options_;
  Log log_;
  Report report_;
  Scene scene_;
  Camera camera_;
  FacetSet facets_;
  PatchSet patches_;
  Methods methods_;
  Situation situation_;
  LightingMaker lightings_;
  std::vector<Variant> variants_;
  std::optional<FactorArchive> kept_;
  std::optional<MethodSpec> spec_;  // the method chosen
  const gpu::Device* solveDevice_ = nullptr;  // null: the CPU
  std::optional<FormFactorMatrix> f_;
  Replicates replicates_;
  ErrorModel model_;
  std::optional<TolerancePlan> plan_;
  Lighting lighting_;
  std::vector<Sensor> sensors_;
};

int printDevices() {
  try {
    for (const gpu::DeviceInfo& d : gpu::listDevices()) {
      fmt::print("{}: {} ({}), Vulkan {}, {}, {:.1f} GiB, layered drawing: {}{}\n", d.index, d.name, d.type,
                 d.apiVersion, d.driver, static_cast<double>(d.memoryBytes) / (1 << 30),
                 d.layeredDrawing ? "yes" : "no",
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
  return Run(options).execute();
}

}  // namespace farol
