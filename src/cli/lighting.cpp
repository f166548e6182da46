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

// On two cores an image costs a patch 0.6 us, as much as a shadow ray costs light that is followed from the lamps.
Shining LightingMaker::shining(const LampPlan& plan, const Scene& scene, const PatchSet& patches, bool imagesOfLamps,
                               size_t mostImages) const {
  Shining s{plan.lamps, scene.lights, std::nullopt, false};
  if (!patches.anySpecular() || (s.lights.empty() && (s.lamps.empty() || !imagesOfLamps))) return s;
  s.mirrors.emplace(facets_, patches);
  const size_t most = std::min(kMostLampImages, mostImages);
  const auto ofLamps =
      lampImages(imagesOfLamps ? std::span<const Lamp>(plan.lamps) : std::span<const Lamp>(), *s.mirrors, methods_.limits(), most);
  const auto ofLights =
      lightImages(scene.lights, facets_.frame, *s.mirrors, methods_.limits(), most - (ofLamps ? ofLamps->size() : 0));
  s.follow = !ofLamps || !ofLights;
  if (s.follow) {
    s.mirrors.reset();
    return s;
  }
  s.lamps.insert(s.lamps.end(), ofLamps->begin(), ofLamps->end());
  s.lights.insert(s.lights.end(), ofLights->begin(), ofLights->end());
  return s;
}

size_t LightingMaker::imagesWanted(const LampPlan& plan, const Scene& scene, const PatchSet& patches) const {
  const Shining s = shining(plan, scene, patches, true, kMostLampImages);
  return s.follow ? 0 : s.lamps.size() + s.lights.size() - plan.lamps.size() - scene.lights.size();
}

// Shadow rays stop at mirrors and glass: what these pass on of lamps apart and punctual lights is followed from there.
void LightingMaker::addFollowed(const PatchSet& patches, std::span<const uint8_t> apart, std::span<const PunctualLight> lights,
                                const std::vector<double>& exposed, DirectLight& direct) const {
  constexpr size_t kPerShadowRay = 4;
  const RayTree tree(methods_.tracer(), facets_, patches, methods_.limits());
  Progress progress(log_, "light over mirrors and through glass", "patches", patches.size());
  const SpecularLight more =
      traceSpecularLight(methods_.tracer(), facets_, patches, tree, apart, lights, exposed,
                         kPerShadowRay * options_.shadowRays * patches.size(), mixBits(options_.seed + 2),
                         [&](double done) { progress.update(static_cast<size_t>(done * static_cast<double>(patches.size()))); });
  for (size_t i = 0; i < patches.size(); ++i) {
    direct.irradiance[i] += more.irradiance[i];
    direct.deviation[i] = glm::sqrt(direct.deviation[i] * direct.deviation[i] + more.deviation[i] * more.deviation[i]);
  }
  direct.rays += more.rays;
}

void LightingMaker::addDirect(const Scene& scene, const PatchSet& patches, const FormFactorMatrix& f, Lighting& lighting) const {
  if (lighting.plan.lamps.empty() && scene.lights.empty()) return;
  std::vector<double> exposed(patches.size());
  for (size_t i = 0; i < exposed.size(); ++i) exposed[i] = f.shares(i).exposed;
  const Shining all = shining(lighting.plan, scene, patches, true);
  const auto computed = [&](std::span<const Lamp> lamps, std::span<const uint8_t> apart) {
    Progress progress(log_, "direct light", "patches", 2 * patches.size());
    DirectLight light = DirectIrradiance(methods_.tracer(), facets_, patches, lamps, all.lights,
                                         {options_.shadowRays, options_.seed, all.mirrors ? &*all.mirrors : nullptr})
                            .compute(exposed, [&](size_t done) { progress.update(done); });
    if (all.follow) addFollowed(patches, apart, scene.lights, exposed, light);
    return light;
  };
  lighting.direct = computed(all.lamps, lighting.plan.apart);
  lighting.direct.apart = lighting.plan.apart;
  if (!scene.lights.empty()) lighting.fromPunctual = computed({}, std::vector<uint8_t>(patches.size())).irradiance;
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
  lighting.error = irradianceError(f, patches, lighting.direct, lighting.solution, replicates, samplesOf(spec), sky);
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

Replicates replicatesOf(Methods& methods, const PatchSet& patches, const MethodSpec& spec, const FormFactorMatrix& f,
                        size_t probes) {
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

ProbeRows makeProbes(Methods& methods, const PatchSet& patches, const MethodSpec& spec, const FormFactorMatrix& f, size_t count,
                     uint32_t better) {
  ProbeRows probes;
  if (spec.kind == MethodSpec::Kind::exact) return probes;
  probes.patches = chooseProbes(patches, count);
  const auto make = [&](const MethodSpec& how, std::vector<FormFactorMatrix>& to) {
    to.emplace_back(f.size());
    methods.maker(how)->makeRows(probes.patches, to.back(), [](size_t) {});
  };
  MethodSpec reference = spec;
  reference.kind = MethodSpec::Kind::rays;
  reference.rays = spec.kind == MethodSpec::Kind::rays       ? better * spec.rays
                   : count > kProbes || spec.resolution > 64 ? 65536
                                                             : 16384;
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
