#include "cli/chart_run.h"

#include "base/error.h"
#include "base/machine.h"
#include "chart/schedule.h"
#include "cli/choices.h"
#include "cli/trials.h"
#include "formfactor/error_model.h"
#include "formfactor/near_field.h"
#include "patch/fingerprint.h"
#include "reference/reference_file.h"

#include <cstring>
#include <fmt/format.h>
#include <memory>

namespace farol {
namespace {

using Kind = MethodSpec::Kind;

// One method over its knob, the cheapest first.
struct Family {
  std::string name;
  std::vector<Setting> settings;
};

constexpr double kResidual = 3e-4;  // far below every sampling error here

Setting raysSetting(uint32_t rays, uint32_t shadowRays) {
  Setting s;
  s.spec.kind = Kind::rays;
  s.spec.rays = rays;
  s.shadowRays = shadowRays;
  s.residual = kResidual;
  return s;
}

Setting hemicubeSetting(Kind kind, uint32_t resolution, int positions, Projection projection, bool nearField) {
  Setting s;
  s.spec.kind = kind;
  s.spec.resolution = resolution;
  s.spec.positions = positions;
  s.spec.projection = projection;
  s.spec.nearField = nearField;
  s.shadowRays = std::max(16u, resolution);
  s.residual = kResidual;
  return s;
}

std::vector<Family> familiesFor(const Scene& scene, const FacetSet& facets, const PatchSet& patches, bool lamps) {
  std::vector<Family> families;
  Family rays{"rays", {}}, matrix{"rays, emitters in F", {}}, jacobi{"rays, Jacobi to 1e-8", {}};
  for (const uint32_t k : {16u, 32u, 64u, 128u, 256u, 512u, 1024u, 4096u, 16384u})
    rays.settings.push_back(raysSetting(k, std::max(8u, k / 4)));
  families.push_back(rays);
  if (lamps) {
    for (const uint32_t k : {256u, 1024u, 4096u, 16384u, 65536u}) {
      matrix.settings.push_back(raysSetting(k, 64));
      matrix.settings.back().emittersApart = false;
    }
    families.push_back(matrix);
  }
  for (const uint32_t k : {64u, 256u}) {
    jacobi.settings.push_back(raysSetting(k, k / 4));
    jacobi.settings.back().solver = SolverKind::jacobi;
    jacobi.settings.back().residual = 1e-8;
  }
  families.push_back(jacobi);
  const auto hemicubes = [&](const std::string& name, Kind kind, std::initializer_list<uint32_t> resolutions, int positions,
                             Projection projection, bool nearField, bool apart) {
    Family f{name, {}};
    for (const uint32_t r : resolutions) {
      f.settings.push_back(hemicubeSetting(kind, r, positions, projection, nearField));
      f.settings.back().emittersApart = apart;
    }
    families.push_back(f);
  };
  const bool specular = patches.anySpecular();
  bool planar = true;
  for (const Facet& f : facets.facets) planar &= !f.transmits;
  if (planar) {
    hemicubes("hemicube", Kind::raster, {16, 32, 64, 128, 256}, 1, Projection::hemicube, true, true);
    if (!specular) {
      hemicubes("hemicube, near field off", Kind::raster, {16, 32, 64, 128, 256}, 1, Projection::hemicube, false, true);
      hemicubes("hemicube, 4 positions", Kind::raster, {16, 32, 64, 128}, 4, Projection::hemicube, true, true);
      hemicubes("tetrahedron", Kind::raster, {16, 32, 64, 128, 256}, 1, Projection::tetrahedron, true, true);
      if (lamps) hemicubes("hemicube, emitters in F", Kind::raster, {32, 64, 128, 256, 512}, 1, Projection::hemicube, true, false);
    }
  }
  if (specular) hemicubes("hybrid", Kind::hybrid, {16, 32, 64, 128, 256}, 1, Projection::hemicube, true, true);
  if (!specular && whatMayBlock(scene, facets).empty()) {
    Setting s;
    s.spec.kind = Kind::exact;
    s.residual = kResidual;
    families.push_back({"closed forms", {s}});
  }
  return families;
}

std::string optionsText(const PatchOptions& size, const Setting& s, uint64_t seed) {
  std::string text = size.size > 0 ? fmt::format("--patch-size {}", size.size) : fmt::format("--patches {}", size.count);
  if (size.cluster > 0) text += fmt::format(" --cluster {}", size.cluster);
  text += fmt::format(" --method {}", methodName(s.spec.kind));
  if (s.spec.hemicubes()) {
    text += fmt::format(" --resolution {} --projection {} --positions {} --near-field {}", s.spec.resolution,
                        projectionName(s.spec.projection), s.spec.positions, s.spec.nearField ? "on" : "off");
  }
  if (s.spec.kind == Kind::rays) text += fmt::format(" --rays {}", s.spec.rays);
  return text + fmt::format(" --emitters {} --shadow-rays {} --solver {} --residual {} --seed {}",
                            s.emittersApart ? "apart" : "matrix", s.shadowRays, solverName(s.solver), s.residual, seed);
}

// Mean over some rows of sum_j |dF_ij| against rows of many rays, and how many patches such a row sees.
class RowReference {
 public:
  explicit RowReference(SizedScene& scene) : probes_(chooseProbes(scene.patches(), kRows)), rows_(scene.patches().size()) {
    MethodSpec many;
    many.kind = Kind::rays;
    many.rays = 1u << 17;
    many.seed = mixBits(scene.options().seed + 5);
    scene.methods().maker(many)->makeRows(probes_, rows_, [](size_t) {});
    for (const uint32_t p : probes_) {
      for (const float f : rows_[p].expanded()) seen_ += f > 0 ? 1.0 / static_cast<double>(probes_.size()) : 0;
    }
  }
  double errorOf(const FormFactorMatrix& f) const {
    double error = 0;
    for (const uint32_t p : probes_) {
      const std::vector<float> here = f[p].expanded(), there = rows_[p].expanded();
      for (size_t j = 0; j < here.size(); ++j)
        error += std::abs(static_cast<double>(here[j] - there[j])) / static_cast<double>(probes_.size());
    }
    return error;
  }
  double seen() const { return std::max(seen_, 1.0); }

 private:
  static constexpr size_t kRows = 24;
  std::vector<uint32_t> probes_;
  FormFactorMatrix rows_;
  double seen_ = 0;
};

double workOf(const Setting& s) { return samplesOf(s.spec) + 1; }

class Measurement {
 public:
  Measurement(const Options& options, const Scene& scene, const FacetSet& facets, Log& log)
      : options_(options), scene_(scene), facets_(facets), log_(log) {}

  ChartRun run(const std::string& cache) {
    ChartRun result;
    Chart& chart = result.chart;
    chart.scene = scene_.path;
    chart.timeAsked = options_.time;
    Progress progress(log_, "chart", "settings", 0);
    try {
      cut();
      gather(cache, chart);
      measure(chart, progress);
    } catch (const Interrupted& e) {
      result.interrupted = e.signal;
      chart.complete = false;
    }
    chart.machine = machineText();
    markFront(chart.points);
    chart.laws = fitLaws(chart.points);
    return result;
  }

 private:
  // The finest first; coarser ones where they have fewer patches.
  void cut() {
    for (const double part : {1.0, 4.0, 16.0}) {
      PatchOptions size = patchOptionsOf(options_);
      size.count = static_cast<size_t>(static_cast<double>(size.count) / part);
      size.size *= std::sqrt(part);
      if (size.size == 0 && size.count < 1) continue;
      auto scene = std::make_unique<SizedScene>(options_, scene_, facets_, size);
      if (!scenes_.empty() && scene->patches().size() * 10 > scenes_.back()->patches().size() * 9) continue;
      scene->solve(raysSetting(64, 16));  // settles which back sides count
      sizes_.push_back(size);
      scenes_.push_back(std::move(scene));
    }
  }

  void gather(const std::string& cache, Chart& chart) {
    SizedScene& finest = *scenes_[0];
    MethodSpec usual;
    const LampPlan lamps = finest.lightings().plan(finest.patches(), usual);
    anyLamps_ = !lamps.lamps.empty();
    std::vector<const PatchSet*> sets;
    for (const auto& s : scenes_) sets.push_back(&s->patches());
    constexpr double kShare = 0.3;
    const double seconds = kShare * options_.time;
    const uint64_t key = keyOf(seconds);
    if (auto kept = readReference(cache, key)) {
      truth_ = std::move(*kept);
    } else {
      Progress progress(log_, "reference", "% of its time", 100);
      const PathGatherer gatherer(finest.methods().tracer(), facets_, finest.patches(), scene_, lamps, options_.sky,
                                  finest.methods().limits());
      if (gatherer.missesLights())
        log_.note("the reference lacks what mirrors and glass pass on of point, spot and directional lights: errors of H hold it");
      truth_ = gatherIrradiance(gatherer, finest.methods().tracer(), facets_, sets, seconds, options_.seed, [&](double done) {
        progress.update(std::min<size_t>(99, static_cast<size_t>(100 * done / seconds)));
      });
      chart.referenceSeconds = watch_.seconds();
      writeReference(cache, key, truth_);
    }
    chart.referencePaths = truth_[0].paths;
    for (size_t s = 0; s < scenes_.size(); ++s) {
      const std::vector<Rgb> nothing(scenes_[s]->patches().size(), Rgb(0));
      chart.referenceError = std::max(chart.referenceError, errorOf(nothing, scenes_[s]->patches(), truth_[s]).standardError);
      rows_.emplace_back(*scenes_[s]);
    }
  }

  // All that the reference depends on.
  uint64_t keyOf(double seconds) const {
    uint64_t key = mixBits(options_.seed);
    const auto mix = [&](double x) {
      uint64_t bits = 0;
      std::memcpy(&bits, &x, sizeof bits);
      key = mixBits(key ^ bits);
    };
    const auto mixRgb = [&](const Rgb& c) {
      mix(c.r);
      mix(c.g);
      mix(c.b);
    };
    mix(seconds);
    mixRgb(options_.sky);
    for (const PunctualLight& l : scene_.lights) {
      mixRgb(l.intensity);
      mixRgb(l.position);
      mixRgb(l.direction);
      mix(l.range);
      mix(l.outerCone);
    }
    for (const auto& s : scenes_) {
      const Fingerprint f = fingerprintOf(facets_, s->patches());
      for (const uint64_t part : {f.geometry, f.patches, f.specular}) key = mixBits(key ^ part);
      for (const Patch& p : s->patches().patches) {
        mixRgb(p.reflectance);
        mixRgb(p.emission);
      }
    }
    return key;
  }

  void measure(Chart& chart, Progress& progress) {
    families_ = familiesFor(scene_, facets_, scenes_[0]->patches(), anyLamps_);
    Schedule schedule;
    std::vector<std::pair<const Family*, size_t>> queues;  // and size
    for (const Family& f : families_) {
      std::vector<double> work;
      for (const Setting& s : f.settings) work.push_back(workOf(s));
      for (size_t s = 0; s < scenes_.size(); ++s) {
        // A software device spends its time on facets, not on pixels.
        constexpr double kPerSample = 1e-8, kPerFacet = 1e-7, kLeast = 1e-3;
        const bool hemicubes = f.settings[0].spec.hemicubes();
        const double perRow = kPerSample * work[0] + (hemicubes ? kPerFacet * static_cast<double>(facets_.facets.size()) : 0);
        schedule.add(hemicubes ? 1 : 0, perRow * static_cast<double>(scenes_[s]->patches().size()) + kLeast, work);
        queues.emplace_back(&f, s);
      }
    }
    size_t done = 0;
    while (const auto next = schedule.next()) {
      // However slow the machine, a few are measured: a chart has something to show.
      constexpr double kMargin = 1.2;
      constexpr size_t kAlways = 3;
      if (done >= kAlways && watch_.seconds() + kMargin * next->seconds > options_.time) {
        chart.complete = false;
        return;
      }
      const auto& [family, size] = queues[next->queue];
      const Stopwatch watch;
      chart.points.push_back(measureOne(family->name, family->settings[next->setting], size));
      schedule.took(watch.seconds(), chart.points.back().repeats * chart.points.back().rowSeconds);
      progress.update(++done);
    }
  }

  // Some repeats with different random numbers where they cost little: the median of times, the rms of errors.
  ChartPoint measureOne(const std::string& series, const Setting& setting, size_t size) {
    constexpr double kCheap = 0.6;
    constexpr int kRepeats = 3;
    SizedScene& scene = *scenes_[size];
    ChartPoint p;
    p.series = series;
    p.method = methodText(setting.spec);
    p.options = optionsText(sizes_[size], setting, options_.seed);
    p.patches = scene.patches().size();
    p.samplesPerPatch = setting.spec.kind == Kind::exact ? 0 : samplesOf(setting.spec) / rows_[size].seen();
    std::vector<std::array<double, 4>> times;
    double squares = 0;
    p.repeats = 0;
    do {
      Setting again = setting;
      again.spec.seed = options_.seed + static_cast<uint64_t>(p.repeats);
      const Trial t = scene.solve(again);
      times.push_back({t.seconds(), t.cpuSeconds, t.rowSeconds, t.lightSeconds});
      const HError e = errorOf(t.lighting.solution.irradiance, scene.patches(), truth_[size]);
      squares += e.error * e.error;
      p.noise = e.noise;
      p.sweeps = t.lighting.solution.sweeps;
      if (p.repeats == 0) p.rowError = rows_[size].errorOf(t.f);
      ++p.repeats;
    } while (p.repeats < kRepeats && times[0][0] < kCheap);
    std::sort(times.begin(), times.end());
    const auto& middle = times[times.size() / 2];
    p.seconds = middle[0];
    p.cpuSeconds = middle[1];
    p.rowSeconds = middle[2];
    p.lightSeconds = middle[3];
    p.error = std::sqrt(squares / p.repeats);
    return p;
  }

  std::string machineText() const {
    std::string device;
    for (const auto& s : scenes_) {
      if (s->methods().deviceOpen()) device = s->methods().device().info().name;
    }
    return fmt::format("{} threads of {}; {}{}{}", coresFor(options_), processorName(),
                       scenes_.empty() ? "" : scenes_[0]->methods().tracer().description(), device.empty() ? "" : "; hemicubes on ",
                       device);
  }

  const Options& options_;
  const Scene& scene_;
  const FacetSet& facets_;
  Log& log_;
  Stopwatch watch_;
  std::vector<PatchOptions> sizes_;
  std::vector<std::unique_ptr<SizedScene>> scenes_;
  std::vector<GatheredIrradiance> truth_;
  std::vector<RowReference> rows_;
  std::vector<Family> families_;
  bool anyLamps_ = false;
};

}  // namespace

ChartRun runChart(const Options& options, const Scene& scene, const FacetSet& facets, const std::string& cache, Log& log) {
  return Measurement(options, scene, facets, log).run(cache);
}

std::string chartText(const Chart& chart) {
  std::string text;
  const auto say = [&]<typename... Args>(fmt::format_string<Args...> format, Args&&... args) {
    text += fmt::format(format, std::forward<Args>(args)...) + "\n";
  };
  std::vector<ChartPoint> front;
  for (const ChartPoint& p : chart.points) {
    if (p.onFront) front.push_back(p);
  }
  std::sort(front.begin(), front.end(), [](const ChartPoint& a, const ChartPoint& b) { return a.seconds < b.seconds; });
  say("reference: {} paths per cell, standard error of H {:.2g} % of its mean", chart.referencePaths, 100 * chart.referenceError);
  say("{} settings measured{}; {} that nothing beats:", chart.points.size(),
      chart.complete ? "" : fmt::format(" in {:.3g} s, not all", chart.timeAsked), front.size());
  for (const ChartPoint& p : front) {
    say("  {:>9.4f} s  {:>7} %  {:<26} {}", p.seconds,
        fmt::format("{}{:.3f}", p.error > p.noise ? "" : "<", 100 * std::max(p.error, p.noise)), p.series, p.options);
  }
  // What the design of the program was made from: one receiver point in an empty box.
  const auto known = [](const std::string& series) -> std::optional<std::pair<double, double>> {
    if (series.starts_with("rays")) return std::pair(0.38, 0.6);
    if (series.starts_with("hemicube")) return std::pair(0.31, 0.57);
    return {};
  };
  for (const ErrorLaw& l : chart.laws) {
    std::string compared;
    if (const auto k = known(l.series)) {
      constexpr double kSamples = 10, kNear = 1.5;
      const double ratio = l.constant * std::pow(kSamples, -l.exponent) / (k->first * std::pow(kSamples, -k->second));
      compared =
          ratio > kNear || ratio < 1 / kNear
              ? fmt::format(": {:.2g} times {:.2f} s^-{:.2f}, known from an empty box, at s = 10", ratio, k->first, k->second)
              : "";
    }
    say("rows of {}: error {:.3g} s^-{:.2f} (s samples per visible patch; {} points){}", l.series, l.constant, l.exponent, l.points,
        compared);
  }
  return text;
}

}  // namespace farol
