#include "cli/lighting.h"

namespace farol {

double samplesOf(const MethodSpec& s) {
  if (s.kind == MethodSpec::Kind::rays) return s.rays;
  if (s.kind == MethodSpec::Kind::exact) return 1e12;
  return (s.projection == Projection::hemicube ? 3.0 : 1.5) * s.resolution * s.resolution * s.positions;
}

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

void LightingMaker::addDirect(const Scene& scene, const PatchSet& patches, const FormFactorMatrix& f,
                              Replicates& replicates, Lighting& lighting) const {
  replicates.direct.reset();
  if (lighting.plan.lamps.empty() && scene.lights.empty()) return;
  std::vector<double> exposed(patches.size());
  for (size_t i = 0; i < exposed.size(); ++i) exposed[i] = f.shares(i).exposed;
  lighting.direct = lamps(lighting.plan, scene, patches, options_.seed).compute(exposed);
  lighting.direct.apart = lighting.plan.apart;
  replicates.direct = lamps(lighting.plan, scene, patches, mixBits(options_.seed + 1)).compute(exposed, replicates.patches);
  if (!scene.lights.empty())
    lighting.fromPunctual = lamps({}, scene, patches, options_.seed).compute(exposed).irradiance;
}

Lighting LightingMaker::make(const Scene& scene, const PatchSet& patches, const Rgb& sky, const FormFactorMatrix& f,
                             const MethodSpec& spec, Replicates& replicates, const gpu::Device* device) const {
  Lighting lighting;
  lighting.plan = plan(patches, spec);
  addDirect(scene, patches, f, replicates, lighting);
  SolveOptions o;
  o.kind = options_.solver;
  o.residual = options_.residual;
  o.maxSweeps = options_.maxSweeps;
  o.sky = sky;
  o.device = device;
  lighting.solution = solveRadiosity(f, patches, lighting.direct, scene, o, log_);
  lighting.error =
      irradianceError(f, patches, lighting.direct, lighting.solution, replicates, samplesOf(spec), sky);
  return lighting;
}

Lighting LightingMaker::local(const Scene& scene, const PatchSet& patches) const {
  Lighting lighting;
  lighting.solution = localIllumination(patches, scene.lights, options_.sky);
  return lighting;
}

double relativeError(const FormFactorMatrix& f, const PatchSet& patches, const Lighting& lighting) {
  double squares = 0, area = 0;
  Rgb total(0);
  for (size_t i = 0; i < patches.size(); ++i) {
    const double a = patches.patches[i].area * f.shares(i).exposed;
    squares += a * lighting.error[i] * lighting.error[i];
    total += a * lighting.solution.irradiance[i];
    area += a;
  }
  const double mean = area > 0 ? maxChannel(total) / area : 0;
  return mean > 0 ? std::sqrt(squares / area) / mean : 0;
}

}  // namespace farol
