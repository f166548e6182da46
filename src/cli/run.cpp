#include "cli/run.h"

#include "base/error.h"
#include "base/output_file.h"
#include "cli/report.h"
#include "formfactor/raster.h"
#include "formfactor/team.h"
#include "output/output.h"
#include "view/tone.h"
#include "view/view.h"

#include <cstdlib>
#include <tbb/global_control.h>
#include <thread>

namespace farol {
namespace {

size_t coresFor(const Options& options) {
  return options.threads > 0 ? static_cast<size_t>(options.threads)
                             : std::max<size_t>(1, std::thread::hardware_concurrency());
}

// How many software devices share the rows, a thread or more each.
size_t softwareDevices(const Options& options) {
  return std::min<size_t>(coresFor(options), 8);
}

// One run of render, solve, factors or info: the stages in order, each leaving its result in a member.
class Run {
 public:
  explicit Run(const Options& options) : options_(options), log_(options.quiet) { report_.options = options; }

  int execute() {
    for (const std::string& path : {options_.output, options_.patchesCsv, options_.report}) {
      if (!path.empty()) requireWritable(path);
    }
    load();
    cut();
    if (options_.command == Command::info) {
      forecast();
    } else {
      if (needsFormFactors()) makeF();
      if (options_.command == Command::factors) {
        writeFactors();
      } else {
        solve();
        if (options_.command == Command::render)
          draw();
        else
          writeSolved();
      }
    }
    return finish();
  }

 private:
  void load() {
    scene_ = loadScene(options_.scene, log_);
    report_.surfaces = scene_.surfaces.size();
    for (const Surface& s : scene_.surfaces) report_.triangles += s.triangles.size();
    if (options_.command == Command::render) camera_ = chooseCamera(scene_, options_.camera);
    report_.clock.finish("load");
  }

  void cut() {
    facets_ = buildFacets(scene_, log_);
    patches_ = buildPatches(scene_, facets_, {options_.patches, options_.patchSize});
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

  bool lit() const { return report_.emittingPatches > 0 || maxChannel(options_.sky) > 0; }

  bool needsFormFactors() {
    if (options_.command == Command::factors) return true;
    if (!lit()) log_.warn(fmt::format("{}: nothing emits light, so the result is black", options_.scene));
    return lit() && !options_.localIllumination;
  }

  void openDevice() {
    if (device_) return;
    device_.emplace(options_.device);
    report_.device = device_->info();
    log_.note(fmt::format("device: {} ({}, {})", device_->info().name, device_->info().type, device_->info().driver));
    report_.clock.finish("device");
  }

  // Makes rows on the device; a software device gets company on machines with several cores.
  std::unique_ptr<RowMaker> rowMaker(size_t batchesPerChunk) {
    openDevice();
    RasterOptions o;
    o.resolution = options_.resolution;
    o.projection = options_.projection;
    o.positions = options_.positions;
    o.seed = options_.seed;
    // Setting up a device takes as long as some hundred hemicubes: small jobs do with fewer.
    constexpr size_t kWorthADevice = 1000;  // hemicubes
    const size_t worthwhile = patches_.frontPatchCount * static_cast<size_t>(options_.positions) / kWorthADevice;
    const size_t team =
        device_->info().type == "CPU" ? std::clamp<size_t>(worthwhile, 1, softwareDevices(options_)) : 1;
    o.deviceMemory /= team;
    while (helpers_.size() + 1 < team) helpers_.emplace_back(std::to_string(device_->info().index));
    std::vector<std::unique_ptr<RowMaker>> makers;
    for (size_t k = 0; k < team; ++k) {
      auto maker = std::make_unique<RasterRowMaker>(k == 0 ? *device_ : helpers_[k - 1], facets_, patches_, o);
      report_.batch = maker->batchSize();
      report_.deviceBytes = team * maker->deviceBytes();
      makers.push_back(std::move(maker));
    }
    report_.devices = team;
    return std::make_unique<TeamRowMaker>(std::move(makers),
                                          batchesPerChunk * report_.batch / static_cast<size_t>(options_.positions));
  }

  uint64_t allowedBytes() const {
    if (options_.memory > 0) return options_.memory;
    const uint64_t free = availableMemoryBytes();
    return free > 0 ? free / 5 * 4 : UINT64_MAX;
  }

  void makeF() {
    const uint64_t least = uint64_t{4} * patches_.frontPatchCount * patches_.size(), allowed = allowedBytes();
    if (least > allowed) {
      throw Error(
          "{}: form factors of {} patches need {:.3g} GB, {:.3g} GB are allowed; ask for fewer patches (--patches), or "
          "allow "
          "more with --memory",
          options_.scene, patches_.size(), static_cast<double>(least) * 1e-9, static_cast<double>(allowed) * 1e-9);
    }
    f_.emplace(patches_.size(), allowed);
    // Chunks of several batches keep a device busy while the host stores rows, and are still small enough to share.
    const std::unique_ptr<RowMaker> maker = rowMaker(3);
    makeFormFactors(*maker, patches_, maxChannel(options_.sky) > 0, log_, *f_);
    countPatches();
    report_.matrixBytes = uint64_t{4} * patches_.size() * patches_.size();
    report_.clock.finish("form factors");
    report_.checks = checkFormFactors(*f_, patches_);
    report_.clock.finish("checks");
    const double seconds = report_.clock.secondsOf("form factors");
    say("form factors: raster {} {}, {} position{}: {} rows in {:.2f} s ({:.0f} rows/s), row sums {:.6f} to {:.6f}, "
        "{:.3g} % missed the scene, "
        "{:.3g} % met backs",
        projectionName(options_.projection), options_.resolution, options_.positions,
        options_.positions == 1 ? "" : "s", patches_.size(), seconds, static_cast<double>(patches_.size()) / seconds,
        report_.checks->rowSumMin, report_.checks->rowSumMax, 100 * report_.checks->missed,
        100 * report_.checks->backs);
  }

  void solve() {
    SolveOptions o;
    o.kind = options_.solver;
    o.residual = options_.residual;
    o.maxSweeps = options_.maxSweeps;
    o.sky = options_.sky;
    if (f_) {
      solution_ = solveRadiosity(*f_, patches_, scene_, o, log_);
      report_.energy = energyBalance(*f_, patches_, solution_, options_.sky);
    } else {
      solution_ = localIllumination(patches_, options_.sky);
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
    say("solve: {} {} sweeps, residual {:.3g}, contraction {:.4f}, error of B {:.2g} of its mean: {}",
        solverName(options_.solver), solution_.sweeps, solution_.residual, solution_.contraction, solution_.error,
        solution_.converged ? "converged" : "NOT converged");
    const EnergyBalance& e = *report_.energy;
    const double in = luminance(e.emitted + e.fromSky);
    say("energy: {:.4g} in, {:.4g} absorbed, {:.4g} to the open, {:.4g} to backs (balance within {:.2g} %)", in,
        luminance(e.absorbed), luminance(e.toOpen), luminance(e.toBacks), 100 * e.relativeError);
  }

  NodeIrradiance nodes() const {
    return NodeIrradiance(scene_, facets_, patches_, f_ ? &*f_ : nullptr, solution_.irradiance);
  }

  void draw() {
    openDevice();
    const NodeIrradiance irradiance = nodes();
    ViewOptions o;
    o.width = options_.width;
    o.height = options_.height;
    o.sky = options_.sky;
    const Image image = renderView(*device_, scene_, facets_, irradiance, camera_, o, log_);
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
    writePatchesCsv(options_.patchesCsv, scene_, patches_, f_ ? &*f_ : nullptr, solution_);
    say("patches: {}", options_.patchesCsv);
  }

  void writeFactors() {
    if (!options_.output.empty()) {
      if (options_.by == "surface")
        writeFactorsBySurface(options_.output, scene_, patches_, *f_);
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
    report_.matrixBytes = uint64_t{4} * patches_.frontPatchCount * patches_.size();
    say("form factors would take {:.4g} MB; {:.4g} MB are allowed", static_cast<double>(report_.matrixBytes) * 1e-6,
        static_cast<double>(allowedBytes()) * 1e-6);
    const std::unique_ptr<RowMaker> maker = rowMaker(1);
    const size_t chunk =
        std::max<size_t>(1, report_.devices * report_.batch / static_cast<uint32_t>(options_.positions));
    FormFactorMatrix warmUp(patches_.size());  // the first rows wait for the driver to compile shaders
    maker->makeRows(std::vector<uint32_t>{0}, warmUp, [](size_t) {});
    size_t rows = 0;
    const Stopwatch watch;
    while (rows < patches_.frontPatchCount && watch.seconds() < kProbeSeconds) {
      std::vector<uint32_t> probe;
      // Rows spread over the scene: neighbours would all be as cheap or as dear as their wall.
      for (size_t k = 0; k < chunk && rows < patches_.frontPatchCount; ++k, ++rows) {
        probe.push_back(static_cast<uint32_t>(rows * 7919 % patches_.frontPatchCount));
      }
      FormFactorMatrix store(patches_.size());
      maker->makeRows(probe, store, [](size_t) {});
    }
    const double rate = static_cast<double>(rows) / watch.seconds();
    say("form factors would take {:.3g} s ({:.0f} rows/s measured on {} rows)",
        static_cast<double>(patches_.frontPatchCount) / rate, rate, rows);
    report_.clock.finish("probe");
  }

  int finish() {
    size_t messages = device_ ? device_->validationMessages() : 0;
    for (const gpu::Device& helper : helpers_) messages += helper.validationMessages();
    if (messages > 0) throw Error("the Vulkan validation layer gave {} messages", messages);
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
  std::optional<gpu::Device> device_;
  std::vector<gpu::Device> helpers_;  // the same software device again
  std::optional<FormFactorMatrix> f_;
  Solution solution_;
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
  setenv("LP_NUM_THREADS", std::to_string(std::max<size_t>(1, coresFor(options) / softwareDevices(options))).c_str(),
         0);
  return Run(options).execute();
}

}  // namespace farol
