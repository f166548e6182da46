#include "cli/lighting.h"

#include "base/machine.h"
#include "light/lamp_images.h"
#include "light/specular_light.h"

#include <bit>

namespace farol {

LampPlan LightingMaker::plan(const PatchSet& patches, const MethodSpec& spec) const {
  if (options_.emittersApart) {
    LampBudget budget;
    budget.shadowRays = options_.shadowRays;
    budget.samplesPerRow = samplesOf(spec);
    budget.secondsPerRow = spec.kind == MethodSpec::Kind::rays ? 3e-8 * budget.samplesPerRow : 2e-4;
    return chooseLamps(facets_, patches, budget);
  }
  LampPlan plan;
  plan.apart.assign(patches.size(), 0);
  plan.why = "asked for";
  return plan;
}

DirectIrradiance LightingMaker::lamps(const LampPlan& plan, const Scene& scene, const PatchSet& patches,
                                      uint64_t seed) const {
  return {methods_.tracer(), facets_, patches, plan.lamps, scene.lights, {options_.shadowRays, seed}};
}

// Shadow rays stop at mirrors and glass: what these pass on of the lamps apart is followed from the lamps.
void LightingMaker::addFollowed(const PatchSet& patches, const std::vector<double>& exposed, DirectLight& direct) const {
  constexpr size_t kPerShadowRay = 4;
  const RayTree tree(methods_.tracer(), facets_, patches, methods_.limits());
  Progress progress(log_, "light over mirrors and through glass", "patches", patches.size());
  const SpecularLight more = traceSpecularLight(methods_.tracer(), facets_, patches, tree, direct.apart, exposed, kPerShadowRay * options_.shadowRays * patches.size(),
                                                mixBits(options_.seed + 2), [&](double done) { progress.update(static_cast<size_t>(done * static_cast<double>(patches.size()))); });
  for (size_t i = 0; i < patches.size(); ++i) {
    direct.irradiance[i] += more.irradiance[i];
    direct.deviation[i] = glm::sqrt(direct.deviation[i] * direct.deviation[i] + more.deviation[i] * more.deviation[i]);
  }
  direct.rays += more.rays;
}

void LightingMaker::addDirect(const Scene& scene, const PatchSet& patches, const FormFactorMatrix& f,
                              Lighting& lighting) const {
  if (lighting.plan.lamps.empty() && scene.lights.empty()) return;
  std::vector<double> exposed(patches.size());
  for (size_t i = 0; i < exposed.size(); ++i) exposed[i] = f.shares(i).exposed;
  std::vector<Lamp> shining = lighting.plan.lamps;
  std::optional<PlanarMirrors> mirrors;
  bool follow = false;
  if (patches.anySpecular() && !shining.empty()) {
    mirrors.emplace(facets_, patches);
    // On two cores an image costs a patch 0.6 us, as much as a shadow ray costs light that is followed from the lamps.
    const auto images = lampImages(shining, *mirrors, methods_.limits(), std::min<size_t>(kMostLampImages, options_.shadowRays));
    follow = !images;
    if (images)
      shining.insert(shining.end(), images->begin(), images->end());
    else
      mirrors.reset();
  }
  const auto computed = [&](std::span<const Lamp> from) {
    Progress progress(log_, "direct light", "patches", 2 * patches.size());
    return DirectIrradiance(methods_.tracer(), facets_, patches, from, scene.lights, {options_.shadowRays, options_.seed, mirrors ? &*mirrors : nullptr})
        .compute(exposed, [&](size_t done) { progress.update(done); });
  };
  lighting.direct = computed(shining);
  lighting.direct.apart = lighting.plan.apart;
  if (follow) addFollowed(patches, exposed, lighting.direct);
  if (!scene.lights.empty())
    lighting.fromPunctual = computed({}).irradiance;
}

Lighting LightingMaker::solve(const Scene& scene, const PatchSet& patches, const Rgb& sky, const FormFactorMatrix& f,
                              const MethodSpec& spec, const gpu::Device* device) const {
  Lighting lighting;
  lighting.plan = plan(patches, spec);
  addDirect(scene, patches, f, lighting);
  SolveOptions o;
  o.kind = options_.solver;
  o.residual = options_.residual;
  o.maxSweeps = options_.maxSweeps;
  o.sky = sky;
  o.device = device;
  lighting.solution = solveRadiosity(f, patches, lighting.direct, scene, o, log_);
  return lighting;
}

Lighting LightingMaker::make(const Scene& scene, const PatchSet& patches, const Rgb& sky, const FormFactorMatrix& f,
                             const MethodSpec& spec, const Replicates& replicates, const gpu::Device* device) const {
  Lighting lighting = solve(scene, patches, sky, f, spec, device);
  lighting.error =
      irradianceError(f, patches, lighting.direct, lighting.solution, replicates, samplesOf(spec), sky);
  for (int c = 1; c < 3 && f.coloured(); ++c) {
    Replicates own = replicates;
    if (own.rows) own.rows = replicates.rows->ofChannel(c);
    const std::vector<Rgb> error =
        irradianceError(f.ofChannel(c), patches, lighting.direct, lighting.solution, own, samplesOf(spec), sky);
    for (size_t i = 0; i < error.size(); ++i) lighting.error[i][c] = error[i][c];
  }
  return lighting;
}

Lighting LightingMaker::local(const Scene& scene, const PatchSet& patches) const {
  Lighting lighting;
  lighting.solution = localIllumination(patches, scene.lights, options_.sky);
  return lighting;
}

namespace {

// Rays for a row whose errors are to be small beside those of a hemicube's: on the Cornell box's chart rays err by 0.50 K^-0.57,
// hemicubes by 0.26 s^-0.34 in L1, and a seventh of the error is 2 % of the variance.
uint32_t raysBeside(double pixels) {
  const double rays = std::pow(7 * 0.50 / (0.26 * std::pow(pixels, -0.34)), 1 / 0.57);
  return std::bit_ceil(static_cast<uint32_t>(std::clamp(rays, 4096.0, 65536.0)));
}

}  // namespace

Replicates replicatesOf(Methods& methods, const PatchSet& patches, const MethodSpec& spec, const FormFactorMatrix& f, size_t probes) {
  Replicates replicates;
  if (spec.kind == MethodSpec::Kind::exact || probes == 0) return replicates;
  const Stopwatch watch;
  MethodSpec again = spec;
  if (again.hemicubes()) {
    again.kind = MethodSpec::Kind::rays;
    again.rays = raysBeside(samplesOf(spec));
    replicates.better = true;
  }
  replicates.patches = chooseProbes(patches, probes);
  again.seed = mixBits(again.seed + 1);
  replicates.rows.emplace(f.size());
  if (f.coloured()) replicates.rows->addChannels();
  methods.maker(again)->makeRows(replicates.patches, *replicates.rows, [](size_t) {});
  replicates.seconds = watch.seconds();
  return replicates;
}

ProbeRows makeProbes(Methods& methods, const PatchSet& patches, const MethodSpec& spec, const FormFactorMatrix& f, size_t count, uint32_t better) {
  ProbeRows probes;
  if (spec.kind == MethodSpec::Kind::exact) return probes;
  probes.patches = chooseProbes(patches, count);
  const auto make = [&](const MethodSpec& how, std::vector<FormFactorMatrix>& to) {
    to.emplace_back(f.size());
    methods.maker(how)->makeRows(probes.patches, to.back(), [](size_t) {});
  };
  MethodSpec reference = spec;
  reference.kind = MethodSpec::Kind::rays;
  reference.rays = spec.kind == MethodSpec::Kind::rays ? better * spec.rays
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

double relativeError(const FormFactorMatrix& f, const PatchSet& patches, const Lighting& lighting) {
  Rgb squares(0), total(0);
  double area = 0;
  for (size_t i = 0; i < patches.size(); ++i) {
    const double a = patches.patches[i].area * f.shares(i).exposed;
    squares += a * lighting.error[i] * lighting.error[i];
    total += a * lighting.solution.irradiance[i];
    area += a;
  }
  double error = 0;
  for (int c = 0; c < 3; ++c) {
    if (total[c] > 0) error = std::max(error, std::sqrt(squares[c] * area) / total[c]);
  }
  return error;
}

}  // namespace farol
