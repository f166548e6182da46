#include "factor_run.h"

namespace farol::test {
namespace {

FacetSet quietFacets(const Scene& scene) {
  Log log(true);
  return buildFacets(scene, log);
}

}  // namespace

FactorRun::FactorRun(Scene s, const PatchOptions& patchOptions)
    : scene(std::move(s)), facets(quietFacets(scene)), patches(buildPatches(scene, facets, patchOptions)), f(patches.size()) {}

std::vector<uint32_t> FactorRun::patchesOf(const std::string& surface) const {
  std::vector<uint32_t> found;
  for (uint32_t i = 0; i < patches.size(); ++i) {
    const std::string name = surfaceNameOf(scene, patches.patches[i]);
    if (name == surface || name == surface + "~back") found.push_back(i);
  }
  return found;
}

void FactorRun::makeRowsOf(const std::string& surface) {
  std::vector<uint32_t> missing;
  for (const uint32_t i : patchesOf(surface)) {
    if (!patches.patches[i].back && !f[i].made()) missing.push_back(i);
  }
  if (!missing.empty()) maker()->makeRows(missing, f, [](size_t) {});
}

double FactorRun::factor(const std::string& from, const std::string& to) {
  makeRowsOf(from);
  std::vector<bool> target(patches.size(), false);
  for (const uint32_t j : patchesOf(to)) target[j] = true;
  double sum = 0, area = 0;
  for (const uint32_t i : patchesOf(from)) {
    if (patches.patches[i].back) continue;
    const double weight = patches.patches[i].area * f.shares(i).exposed;
    f[i].forEach([&](size_t j, double value) { sum += target[j] ? weight * value : 0; });
    area += weight;
  }
  return sum / area;
}

double FactorRun::factorError(const ErrorModel& model, const std::string& from, const std::string& to, bool oneSign) const {
  const std::vector<uint32_t> targets = patchesOf(to);
  double variance = 0, total = 0, area = 0;
  for (const uint32_t i : patchesOf(from)) {
    if (patches.patches[i].back) continue;
    const std::vector<float> row = f[i].expanded();
    double sum = 0;
    for (const uint32_t j : targets) sum += static_cast<double>(row[j]);
    const double error = patches.patches[i].area * model.entryError(sum);
    variance += error * error;
    total += error;
    area += patches.patches[i].area;
  }
  return (oneSign ? total : std::sqrt(variance)) / area;
}

std::vector<uint32_t> FactorRun::probePatches(size_t count) const {
  std::vector<uint32_t> made, chosen;
  for (uint32_t i = 0; i < patches.size(); ++i) {
    if (f[i].made()) made.push_back(i);
  }
  count = std::min(count, made.size());
  for (size_t k = 0; k < count; ++k) chosen.push_back(made[(2 * k + 1) * made.size() / (2 * count)]);
  return chosen;
}

void FactorRun::makeAll() { makeFormFactors(*maker(), patches, false, Log(true), f); }

RayRun::RayRun(Scene s, const PatchOptions& patchOptions, const RayOptions& rayOptions)
    : FactorRun(std::move(s), patchOptions), options(rayOptions), tracer(facets) {}

std::unique_ptr<RowMaker> RayRun::maker() { return std::make_unique<RayRowMaker>(tracer, facets, patches, options); }

ProbeRows RayRun::probes() {
  ProbeRows rows;
  rows.patches = probePatches(24);
  const auto make = [&](uint32_t rays, uint64_t seed, std::vector<FormFactorMatrix>& to) {
    RayOptions o = options;
    o.rays = rays;
    o.seed = mixBits(seed);
    to.emplace_back(patches.size());
    RayRowMaker(tracer, facets, patches, o).makeRows(rows.patches, to.back(), [](size_t) {});
  };
  make(16 * options.rays, options.seed, rows.reference);
  for (uint64_t k = 1; k <= 48 / std::max<size_t>(1, rows.patches.size()); ++k) make(options.rays, options.seed + k, rows.again);
  return rows;
}

ErrorModel RayRun::errorModel() { return fitErrorModel(f, patches, probes(), options.rays); }

}  // namespace farol::test
