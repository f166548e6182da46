#include "cli/run.h"

#include "base/error.h"
#include "base/output_file.h"
#include "cli/comparison_text.h"
#include "cli/methods.h"
#include "cli/report.h"
#include "formfactor/near_field.h"
#include "output/factor_archive.h"
#include "output/output.h"
#include "output/sensor_files.h"
#include "solve/irradiance_error.h"
#include "view/tone.h"
#include "view/view.h"

#include <cstdlib>
#include <numeric>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <thread>

namespace farol {
namespace {

constexpr size_t kProbes = 24;  // rows made better to tell how good the others are; more when methods are compared

// One run of render, solve, factors, compare or info: the stages in order, each leaving its result in a member.
class Run {
 public:
  explicit Run(const Options& options)
      : options_(options), log_(options.quiet), methods_(options_, facets_, patches_, log_) {
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
        planLight();
        forecast();
        break;
      case Command::compare:
        compare();
        break;
      case Command::factors:
        chooseMethod();
        makeF();
        writeFactors();
        break;
      default:
        if (needsFormFactors()) {
          if (kept_) {
            planLight();
            loadF();
          } else {
            chooseMethod();
            planLight();
            makeF();
          }
          makeDirect();
        }
        solve();
        readSensorsHere();
        if (options_.command == Command::render)
          draw();
        else
          writeSolved();
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
    report_.clock.finish("load");
  }

  // The file of factors also says which patches they are for.
  void openKept() {
    kept_.emplace(options_.factors);
    const PatchOptions& p = kept_->about().patches;
    if (options_.patchesAsked && (p.size != options_.patchSize || (p.size == 0 && p.count != options_.patches))) {
      throw Error("{}: these factors are for {}; leave --patches and --patch-size out", options_.factors,
                  p.size > 0 ? fmt::format("--patch-size {}", p.size) : fmt::format("--patches {}", p.count));
    }
    options_.patches = report_.options.patches = p.count;
    options_.patchSize = report_.options.patchSize = p.size;
    spec_ = parseMethod(kept_->about().method);
    spec_->seed = kept_->about().seed;
    report_.why = fmt::format("kept in {}", options_.factors);
  }

  void cut() {
    facets_ = buildFacets(scene_, log_);
    patches_ = buildPatches(scene_, facets_, {options_.patches, options_.patchSize});
    if (kept_) kept_->requireSame(fingerprintOf(facets_, patches_), options_.scene);
    report_.facets = facets_.facets.size();
    report_.degenerate = facets_.degenerate;
    report_.duplicate = facets_.duplicate;
    report_.welded = facets_.welded;
    if (options_.patchSize == 0 && facets_.facets.size() > options_.patches / 2) {
      log_.note(fmt::format("{} facets need at least a patch each: {} patches instead of about {}",
                            facets_.facets.size(), patches_.frontPatchCount, options_.patches));
    }
    countPatches();
    warnOfSpecular();
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
      if (maxChannel(p.specular) > 0) ++report_.specularPatches;
      if (p.emits()) ++report_.emittingPatches;
    }
  }

  void warnOfSpecular() {
    double area = 0;
    std::string first;
    for (const Patch& p : patches_.patches) {
      if (p.back || !(maxChannel(p.specular) > 0)) continue;
      if (first.empty()) first = surfaceNameOf(scene_, p);
      area += p.area;
    }
    if (area > 0) {
      log_.warn(fmt::format(
          "mirrors and clear glass ({:.4g} square units, first on surface '{}') are not traced yet: their specular "
          "share counts as absorbed",
          area, first));
    }
  }

  bool lit() const {
    return report_.emittingPatches > 0 || maxChannel(options_.sky) > 0 || !scene_.lights.empty();
  }

  bool needsFormFactors() {
    if (!lit()) log_.warn(fmt::format("{}: nothing emits light, so the result is black", options_.scene));
    return lit() && !options_.localIllumination;
  }

  MethodSpec specOf(MethodSpec::Kind kind) const {
    return {kind,           options_.resolution, options_.projection, options_.positions, options_.nearField, "",
            raysOf(options_), options_.seed};
  }

  // What `auto` means: closed forms where nothing can block and they cost little; rays, unless there is a GPU: then
  // both make some rows and rays must lead by 20 %.
  void chooseMethod() {
    using Kind = MethodSpec::Kind;
    if (options_.method == "exact") {
      const std::string blocker = whatMayBlock(scene_, facets_);
      if (!blocker.empty()) {
        throw Error("{}: closed forms hold only where nothing can block: {}; use --method rays or raster",
                    options_.scene, blocker);
      }
    }
    if (options_.method != "auto") {
      report_.why = "asked for";
      spec_ = specOf(options_.method == "raster" ? Kind::raster
                     : options_.method == "rays" ? Kind::rays
                                                 : Kind::exact);
      return;
    }
    constexpr double kSecondsPerPair = 6e-7, kExactSeconds = 5;
    const double n = static_cast<double>(patches_.frontPatchCount);
    if (options_.command == Command::factors && options_.rays == 0 &&
        n * n * kSecondsPerPair / static_cast<double>(coresFor(options_)) < kExactSeconds &&
        whatMayBlock(scene_, facets_).empty()) {
      spec_ = specOf(Kind::exact);
      report_.why = "nothing in the scene can block, and closed forms of all pairs cost little";
      return;
    }
    spec_ = specOf(Kind::rays);
    report_.why = "no GPU: a software device is slower than rays";
    // Looking for a GPU takes longer than many a scene's rays.
    constexpr double kSecondsPerRay = 3e-8, kWorthLooking = 1;
    if (n * raysOf(options_) * kSecondsPerRay / static_cast<double>(coresFor(options_)) < kWorthLooking) {
      report_.why = "rays take less time than looking for a GPU";
      return;
    }
    for (const gpu::DeviceInfo& d : usableDevices()) {
      if (d.type == "CPU") continue;
      const double rays = rowsPerSecond(specOf(Kind::rays)), raster = rowsPerSecond(specOf(Kind::raster));
      // At equal row errors: hemicubes 0.31 s^-0.57, rays 0.38 s^-0.6 (s samples per visible patch).
      const double pixels = 3.0 * options_.resolution * options_.resolution;
      const double worth = std::pow(0.31 / 0.38, 2) * std::pow(pixels, -1.14) / std::pow(raysOf(options_), -1.2);
      const bool raysLead = rays > 1.2 * raster / worth;
      if (!raysLead) spec_ = specOf(Kind::raster);
      report_.why = fmt::format("measured on {}: {:.0f} rows/s by raster, {:.0f} by rays; equal errors cost {:.2g} times", d.name, raster, rays, raster / worth / rays);
      break;
    }
  }

  static std::vector<gpu::DeviceInfo> usableDevices() {
    try {
      std::vector<gpu::DeviceInfo> all = gpu::listDevices();
      std::erase_if(all, [](const gpu::DeviceInfo& d) { return !d.refusal.empty(); });
      return all;
    } catch (const Error&) {  // no Vulkan here: rays need none
      return {};
    }
  }

  // Rows spread over the scene: neighbours would all be as cheap or as dear as their wall.
  double rowsPerSecond(const MethodSpec& spec, double seconds = 0.1) {
    const std::unique_ptr<RowMaker> maker = methods_.maker(spec);
    FormFactorMatrix warmUp(patches_.size());  // the first rows wait for a driver to compile shaders
    maker->makeRows(std::vector<uint32_t>{0}, warmUp, [](size_t) {});
    const size_t chunk = std::max<size_t>(32, methods_.softwareDevices * methods_.batch);
    size_t rows = 0;
    const Stopwatch watch;
    while (rows < patches_.frontPatchCount && watch.seconds() < seconds) {
      std::vector<uint32_t> probe;
      for (size_t k = 0; k < chunk && rows < patches_.frontPatchCount; ++k, ++rows)
        probe.push_back(static_cast<uint32_t>(rows * 7919 % patches_.frontPatchCount));
      FormFactorMatrix store(patches_.size());
      maker->makeRows(probe, store, [](size_t) {});
    }
    return static_cast<double>(rows) / watch.seconds();
  }

  void planLight() {
    plan_.apart.assign(patches_.size(), 0);
    plan_.why = "asked for";
    if (options_.emittersApart) {
      LampBudget budget;
      budget.shadowRays = options_.shadowRays;
      budget.samplesPerRow = samplesOf(*spec_);
      budget.secondsPerRow = spec_->kind == MethodSpec::Kind::rays ? 3e-8 * budget.samplesPerRow : 2e-4;
      plan_ = chooseLamps(facets_, patches_, budget);
    }
    report_.lamps = plan_.lamps.size();
    report_.emitters = plan_.emitters;
    report_.lampsWhy = plan_.why;
    if (report_.emittingPatches > 0) say("emitters: {}", plan_.why);
    report_.clock.finish("plan");
  }

  // Samples of the hemisphere per row, for laws of error.
  static double samplesOf(const MethodSpec& s) {
    if (s.kind == MethodSpec::Kind::rays) return s.rays;
    if (s.kind == MethodSpec::Kind::exact) return 1e12;
    return (s.projection == Projection::hemicube ? 3.0 : 1.5) * s.resolution * s.resolution * s.positions;
  }

  uint64_t allowedBytes() const {
    if (options_.memory > 0) return options_.memory;
    const uint64_t free = availableMemoryBytes();
    return free > 0 ? free / 5 * 4 : UINT64_MAX;
  }

  // Of one row: a list of hits where that is much shorter than a dense row.
  uint64_t rowBytes(const MethodSpec& s) const {
    return uint64_t{4} * (s.kind == MethodSpec::Kind::rays && 4 * uint64_t{s.rays} <= patches_.size() ? s.rays
                                                                                                  : patches_.size());
  }

  void requireMemory(const MethodSpec& spec) const {
    const uint64_t least = rowBytes(spec) * patches_.frontPatchCount, allowed = allowedBytes();
    if (least > allowed) {
      throw Error(
          "{}: form factors of {} patches need {:.3g} GB, {:.3g} GB are allowed; ask for fewer patches (--patches), or "
          "allow more with --memory",
          options_.scene, patches_.size(), static_cast<double>(least) * 1e-9, static_cast<double>(allowed) * 1e-9);
    }
  }

  void makeF() {
    requireMemory(*spec_);
    if (spec_->kind == MethodSpec::Kind::raster) {
      methods_.device();
      report_.clock.finish("device");
    }
    f_.emplace(patches_.size(), allowedBytes());
    const std::unique_ptr<RowMaker> maker = methods_.maker(*spec_);
    // A kept F may be lit from anywhere: it has a row for every patch.
    const bool all = maxChannel(options_.sky) > 0 || options_.output.ends_with(".npz");
    const std::vector<uint32_t> kept = makeFormFactors(*maker, patches_, all, log_, *f_);
    if (!kept.empty() && !plan_.apart.empty()) plan_.keep(kept);
    countPatches();
    report_.matrixBytes = f_->bytes();
    report_.clock.finish("form factors");
    model_ = fitErrorModel(*f_, patches_, makeProbes(*spec_, *f_, kProbes), samplesOf(*spec_));
    replicateRows();
    if (spec_->kind == MethodSpec::Kind::exact) model_ = {};
    report_.errorModel = model_;
    report_.checks = checkFormFactors(*f_, patches_);
    reportRowErrors();
    warnOfBrokenRules();
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
  }

  // F as it was kept. How good its rows are was told when they were made.
  void loadF() {
    f_.emplace(kept_->load(patches_.size(), allowedBytes()));
    report_.matrixBytes = f_->bytes();
    report_.clock.finish("form factors");
    replicateRows();
    report_.checks = checkFormFactors(*f_, patches_);
    report_.clock.finish("checks");
    say("form factors: {} rows of {} in {:.2f} s from {}", f_->size(), kept_->about().method,
        report_.clock.secondsOf("form factors"), options_.factors);
  }

  // Rows of a few patches by many rays, as a reference; in scenes of few patches also rows like F's with other seeds.
  ProbeRows makeProbes(const MethodSpec& spec, const FormFactorMatrix& f, size_t count) {
    ProbeRows probes;
    if (spec.kind == MethodSpec::Kind::exact) return probes;
    probes.patches = chooseProbes(patches_, count);
    const auto make = [&](const MethodSpec& how, std::vector<FormFactorMatrix>& to) {
      to.emplace_back(f.size());
      methods_.maker(how)->makeRows(probes.patches, to.back(), [](size_t) {});
    };
    MethodSpec reference = spec;
    reference.kind = MethodSpec::Kind::rays;
    reference.rays = spec.kind == MethodSpec::Kind::rays ? 16 * spec.rays
                     : count > kProbes || spec.resolution > 64 ? 65536 : 16384;
    if (spec.kind == MethodSpec::Kind::rays) reference.rays = std::min(reference.rays, std::max(2 * spec.rays, 1u << 18));
    reference.seed = mixBits(spec.seed);
    make(reference, probes.reference);
    if (spec.kind == MethodSpec::Kind::rays && !probes.patches.empty()) {
      constexpr size_t kMostRays = size_t{1} << 22;
      for (size_t k = 1; k + 1 < 2 * count / probes.patches.size() && k * spec.rays * probes.patches.size() < kMostRays; ++k) {
        MethodSpec again = spec;
        again.seed = mixBits(spec.seed + k);
        make(again, probes.again);
      }
    }
    return probes;
  }

  // Rows of about every sixteenth patch once more, by other random numbers or, for raster, by many rays: their
  // differences tell the error of H.
  void replicateRows() {
    if (spec_->kind == MethodSpec::Kind::exact) return;
    constexpr size_t kFewest = 384, kShare = 16;
    MethodSpec again = *spec_;
    if (again.kind == MethodSpec::Kind::raster) {
      again.kind = MethodSpec::Kind::rays;
      again.rays = 65536;
      replicates_.better = true;
    }
    replicates_.patches = chooseProbes(patches_, std::max(replicates_.better ? kFewest / 2 : kFewest, patches_.size() / kShare));
    again.seed = mixBits(again.seed + 1);
    replicates_.rows.emplace(f_->size());
    methods_.maker(again)->makeRows(replicates_.patches, *replicates_.rows, [](size_t) {});
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

  void warnOfBrokenRules() {
    const FormFactorChecks& c = *report_.checks;
    if (c.correctionMin < 0.8 || c.correctionMax > 1.25) {
      log_.warn(fmt::format("the near-field correction scaled entries by {:.3f} to {:.3f}: outside 0.8 to 1.25 one "
                            "position does not do; use --positions or --method rays",
                            c.correctionMin, c.correctionMax));
    }
    if (c.smallest < 0 || c.largest > 1 + 1e-6) {
      log_.warn(fmt::format("form factors reach from {:.6g} to {:.6g}; 0 to 1 is possible", c.smallest, c.largest));
    }
    if (c.worstArea <= 1) return;
    const Patch &from = patches_.patches[c.worstFrom], &to = patches_.patches[c.worstTo];
    const double f = (*f_)[c.worstFrom].at(c.worstTo), spread = 4 * model_.entryError(f);
    if (f > 0 && c.worstArea * (1 - spread / f) > 1 + 1e-6) {
      log_.warn(fmt::format(
          "patch {} on '{}' sends {:.3g} times what can reach patch {} on '{}': more than the estimated error explains",
          c.worstFrom, surfaceNameOf(scene_, from), c.worstArea, c.worstTo, surfaceNameOf(scene_, to)));
    }
  }

  std::vector<double> exposedShares() const {
    std::vector<double> shares(patches_.size());
    for (size_t i = 0; i < shares.size(); ++i) shares[i] = f_->shares(i).exposed;
    return shares;
  }

  DirectIrradiance lampsAndLights(uint64_t seed) {
    return {methods_.tracer(), facets_, patches_, plan_.lamps, scene_.lights, {options_.shadowRays, seed}};
  }

  void makeDirect() {
    if (plan_.lamps.empty() && scene_.lights.empty()) return;
    const std::vector<double> exposed = exposedShares();
    direct_ = lampsAndLights(options_.seed).compute(exposed);
    direct_.apart = plan_.apart;
    report_.shadowRays = direct_.rays;
    replicates_.direct = lampsAndLights(mixBits(options_.seed + 1)).compute(exposed, replicates_.patches);
    if (!scene_.lights.empty()) {
      fromPunctual_ = DirectIrradiance(methods_.tracer(), facets_, patches_, {}, scene_.lights,
                                       {options_.shadowRays, options_.seed})
                          .compute(exposed)
                          .irradiance;
    }
    report_.clock.finish("direct light");
  }

  void solve() {
    SolveOptions o;
    o.kind = options_.solver;
    o.residual = options_.residual;
    o.maxSweeps = options_.maxSweeps;
    o.sky = options_.sky;
    if (f_) {
      solution_ = solveRadiosity(*f_, patches_, direct_, scene_, o, log_);
      report_.energy = energyBalance(*f_, patches_, solution_, options_.sky, fromPunctual_);
      error_ = irradianceError(*f_, patches_, direct_, solution_, replicates_, samplesOf(*spec_), options_.sky);
      report_.estimatedError = relativeError();
    } else {
      solution_ = localIllumination(patches_, scene_.lights, options_.sky);
    }
    report_.solution = solution_;
    report_.solution->radiosity.clear();
    report_.solution->irradiance.clear();
    report_.clock.finish("solve");
    if (!f_) {
      say("{}", options_.localIllumination && lit()
                    ? "local illumination: emitters as points, nothing in between, no interreflection"
                    : "nothing to solve: black");
      return;
    }
    say("light: {} of {} lamps apart, {} punctual lights, {} shadow rays; error of H {:.2g} of its mean (rms, estimated)",
        report_.lamps, report_.emitters, scene_.lights.size(), report_.shadowRays, *report_.estimatedError);
    say("solve: {} {} sweeps, residual {:.3g}, contraction {:.4f}, error of B {:.2g} of its mean: {}",
        solverName(options_.solver), solution_.sweeps, solution_.residual, solution_.contraction, solution_.error,
        solution_.converged ? "converged" : "NOT converged");
    const EnergyBalance& e = *report_.energy;
    const double in = luminance(e.emitted + e.fromSky + e.fromPunctual);
    say("energy: {:.4g} in, {:.4g} absorbed, {:.4g} to the open, {:.4g} to backs (balance within {:.2g} %)", in,
        luminance(e.absorbed), luminance(e.toOpen), luminance(e.toBacks), 100 * e.relativeError);
  }

  // Root of the area-weighted mean square of err, over the mean of H.
  double relativeError() const {
    double squares = 0, area = 0;
    Rgb total(0);
    for (size_t i = 0; i < patches_.size(); ++i) {
      const double a = patches_.patches[i].area * f_->shares(i).exposed;
      squares += a * error_[i] * error_[i];
      total += a * solution_.irradiance[i];
      area += a;
    }
    const double mean = area > 0 ? maxChannel(total) / area : 0;
    return mean > 0 ? std::sqrt(squares / area) / mean : 0;
  }

  void readSensorsHere() {
    if (sensors_.empty()) return;
    if (!f_) throw Error("{}: sensors need a global solution of a scene with light", options_.scene);
    SensorOptions o;
    o.seed = options_.seed;
    o.sky = options_.sky;
    const auto readings = readSensors(methods_.tracer(), facets_, patches_, lampsAndLights(options_.seed), direct_,
                                      solution_, sensors_, o);
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

  // One side of a comparison: a matrix with its name and error model.
  struct Side {
    std::string name;
    FormFactorMatrix f;
    ErrorModel error;
    double seconds = 0;
  };

  static bool isFile(const std::string& text) { return text.ends_with(".npy") || text.ends_with(".npz"); }

  FormFactorMatrix loadFile(const std::string& path) const {
    if (path.ends_with(".npy")) return loadFactorsNpy(path, patches_.size());
    const FactorArchive archive(path);
    archive.requireSame(fingerprintOf(facets_, patches_), options_.scene);
    return archive.load(patches_.size(), allowedBytes() / 2);
  }

  Side makeSide(const std::string& text, std::optional<MethodSpec> spec) {
    const Stopwatch watch;
    if (!spec) return {text, loadFile(text), {}, watch.seconds()};
    requireMemory(*spec);
    Side side{methodText(*spec), FormFactorMatrix(patches_.size(), allowedBytes() / 2), {}, 0};
    const std::unique_ptr<RowMaker> maker = methods_.maker(*spec);
    // Every patch has a row on both sides, whatever each method sees; beside a file the patches that the file has.
    makeFormFactors(*maker, patches_, !isFile(options_.methodA) && !isFile(options_.methodB), log_, side.f);
    side.seconds = watch.seconds();
    constexpr size_t kMany = 256;
    side.error = fitErrorModel(side.f, patches_, makeProbes(*spec, side.f, kMany), samplesOf(*spec));
    if (spec->kind == MethodSpec::Kind::exact) side.error = {};
    return side;
  }

  void compare() {
    const auto specOf = [&](const std::string& text) {
      if (isFile(text)) return std::optional<MethodSpec>();
      std::optional<MethodSpec> spec = parseMethod(text);
      spec->seed = options_.seed;
      const std::string blocker = spec->kind == MethodSpec::Kind::exact ? whatMayBlock(scene_, facets_) : "";
      if (!blocker.empty()) throw Error("{}: closed forms hold only where nothing can block: {}", options_.scene, blocker);
      return spec;
    };
    const auto specA = specOf(options_.methodA), specB = specOf(options_.methodB);
    // A method comes before a file: it settles which patches there are.
    std::optional<Side> a, b;
    if (!specA && specB) b = makeSide(options_.methodB, specB);
    a = makeSide(options_.methodA, specA);
    if (!b) b = makeSide(options_.methodB, specB);
    spec_ = specA ? specA : specB ? specB : std::optional(this->specOf(MethodSpec::Kind::rays));
    report_.clock.finish("form factors");
    const Comparison c = compareFactors(a->f, a->error, b->f, b->error, patches_);
    const bool estimated = a->error.samples > 0 || b->error.samples > 0;
    report_.comparison = ComparisonReport{a->name,
                                          b->name,
                                          c,
                                          checkFormFactors(a->f, patches_),
                                          checkFormFactors(b->f, patches_),
                                          radiosityChange(a->f, b->f),
                                          a->seconds,
                                          b->seconds,
                                          estimated,
                                          {}};
    for (const uint32_t p : {c.worst, c.rows[c.worst].more, c.rows[c.worst].less})
      report_.comparison->worst.push_back(p == kNone ? "" : surfaceNameOf(scene_, patches_.patches[p]));
    report_.clock.finish("compare");
    say("{}", comparisonText(*report_.comparison, scene_, patches_));
    if (!options_.output.empty()) drawDifference(c);
  }

  // Both solved with the same lamps: rms difference of H over the mean of H, worst channel; 0 without light.
  double radiosityChange(const FormFactorMatrix& a, const FormFactorMatrix& b) {
    if (!lit()) return 0;
    planLight();
    f_ = a;
    makeDirect();
    SolveOptions o;
    o.sky = options_.sky;
    const Solution first = solveRadiosity(a, patches_, direct_, scene_, o, log_),
                   second = solveRadiosity(b, patches_, direct_, scene_, o, log_);
    Rgb squares(0), total(0);
    for (size_t i = 0; i < patches_.size(); ++i) {
      const Rgb d = first.irradiance[i] - second.irradiance[i];
      squares += patches_.patches[i].area * d * d;
      total += patches_.patches[i].area * 0.5 * (first.irradiance[i] + second.irradiance[i]);
    }
    double worst = 0;
    for (int k = 0; k < 3; ++k) {
      if (total[k] > 0) worst = std::max(worst, std::sqrt(squares[k] * report_.area) / total[k]);
    }
    return worst;
  }

  void drawDifference(const Comparison& c) {
    const std::vector<Rgb> colors = differenceColors(c);
    solution_.irradiance.assign(patches_.size(), Rgb(0));
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
    return NodeIrradiance(scene_, facets_, patches_, f_ ? &*f_ : nullptr, solution_.irradiance);
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
    writePatchesCsv(options_.patchesCsv, scene_, patches_, f_ ? &*f_ : nullptr, solution_, error_);
    say("patches: {}", options_.patchesCsv);
  }

  void writeFactors() {
    if (!options_.output.empty()) {
      if (options_.by == "surface")
        writeFactorsBySurface(options_.output, scene_, patches_, *f_);
      else if (options_.output.ends_with(".npz"))
        writeFactorsNpz(options_.output, *f_, patches_,
                        {methodText(*spec_), spec_->seed, {options_.patches, options_.patchSize},
                         fingerprintOf(facets_, patches_)});
      else if (options_.output.ends_with(".npy"))
        writeFactorsNpy(options_.output, *f_);
      else
        writeFactorsMtx(options_.output, *f_);
      say("factors: {}", options_.output);
    }
    report_.clock.finish("write");
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
    report_.matrixBytes = rowBytes(*spec_) * patches_.frontPatchCount;
    say("form factors would take {:.4g} MB; {:.4g} MB are allowed", static_cast<double>(report_.matrixBytes) * 1e-6,
        static_cast<double>(allowedBytes()) * 1e-6);
    const double rate = rowsPerSecond(*spec_, kProbeSeconds);
    say("form factors would take {:.3g} s ({:.0f} rows/s measured)",
        static_cast<double>(patches_.frontPatchCount) / rate, rate);
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
    return report_.solution && !report_.solution->converged ? 3 : 0;
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
  std::optional<FactorArchive> kept_;
  std::optional<MethodSpec> spec_;  // the method chosen
  LampPlan plan_;
  std::optional<FormFactorMatrix> f_;
  Replicates replicates_;
  ErrorModel model_;
  DirectLight direct_;
  std::vector<Rgb> fromPunctual_;  // irradiance by punctual lights
  Solution solution_;
  std::vector<double> error_;  // of H per patch
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
  setenv("LP_NUM_THREADS", std::to_string(std::max<size_t>(1, coresFor(options) / mostSoftwareDevices(options))).c_str(),
         0);
  return Run(options).execute();
}

}  // namespace farol
