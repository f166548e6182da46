#include "cli/trial_laws.h"

#include "cli/sample_counts.h"

namespace farol {
namespace {

using Kind = MethodSpec::Kind;

constexpr size_t kMoreSweeps = 2;  // that look at all of F: for the residual, and for errors

// Entries of F that a sweep reads.
double filled(double n, const MethodSpec& spec) { return n * (spec.kind == Kind::rays ? std::min(n, 1.0 * spec.rays) : n); }

double sweepSeconds(double n, const MethodSpec& spec, size_t sweeps) {
  return kSecondsPerEntry * filled(n, spec) * static_cast<double>(sweeps + kMoreSweeps);
}

}  // namespace

void TrialLaws::learnCosts(const Trial& trial) {
  const auto n = static_cast<double>(patches);
  const size_t rays = trial.lighting.direct.rays;
  shadowShare = rays > 0 ? static_cast<double>(rays) / (n * setting.shadowRays) : 0;
  perSample = trial.rowSeconds / (n * samplesOf(setting.spec));
  // Direct light and solve are told apart by what a sweep costs about.
  perShadowRay = std::max(0.0, trial.lightSeconds - sweepSeconds(n, setting.spec, sweeps)) /
                 (n * std::max(1.0, shadowShare * setting.shadowRays));
}

ErrorParts TrialLaws::errorFor(double n, const Setting& s) const {
  ErrorParts e;
  e.patches = patchError.at(std::pow(n / static_cast<double>(patches), -1 / perSize));
  e.rows = rowError * std::pow(worthOf(s.spec) / worthOf(setting.spec), -orderOf(s.spec));
  e.light = lightError * std::pow(worthOf(s.shadowRays) / worthOf(setting.shadowRays), -kSampleOrder);
  e.sweeps = s.residual;
  return e;
}

double TrialLaws::secondsFor(double n, const Setting& s) const {
  return n * (samplesOf(s.spec) * perSample + shadowWork(s.shadowRays) * perShadowRay) + sweepSeconds(n, s.spec, sweeps);
}

double TrialLaws::bytesFor(double n, const Setting& s) const {
  const double row = s.spec.kind == Kind::rays ? std::min(4.0 * s.spec.rays, 2 * n) : 2 * n;
  return channels * fronts * n * row;
}

// Where the trial followed light of lamps that more rays would choose images for, an image takes as long as three of its rays, and
// a ray to one half as long: between facing mirrors of 110 images.
double TrialLaws::shadowWork(uint32_t rays) const {
  constexpr double kPerImage = 3, kPerRay = 0.9;
  const auto wanted = static_cast<double>(images);
  return images > setting.shadowRays && images <= rays ? kPerImage * wanted + kPerRay * rays : shadowShare * rays;
}

}  // namespace farol
